"""The paper's study, repeated: which policies are trained, and on what they are measured.

One first phase is shared. From its weights go on SEEK and its memory-free twin, three seeds each,
with as many further updates, and every ablation once. `full` is the study; `tiny` is the same chain
in minutes, to see that it works, and says nothing about memory.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from hide_tasks.contract import Split
from seek_model.config import Config
from seek_model.presets import CLOCK

FIRST = "first"
SEEDS = (0, 1, 2)
ABLATED = ("length_0", "length_2", "length_4", "proprioception", "scm", "wcm", "pam", "scm_wcm")
SPLIT: Split = "test"  # that is measured on
Settings = Mapping[str, object]


class Run(NamedTuple):
    """One training."""

    name: str  # of its folder
    policy: str  # on the server; its seeds are versions
    preset: str
    seed: int
    start: str  # the run whose first phase it goes on from; empty: it is that run


class Study(NamedTuple):
    """Trainings, and what they are trained and measured on."""

    name: str
    runs: tuple[Run, ...]  # in the order of training
    tasks: tuple[str, ...]  # empty: all
    demonstrations: Mapping[Split, int | None]  # of each task; None: all of the split
    episodes: int | None  # of each task, of SPLIT; None: all
    settings: Mapping[str, Settings]  # tables that change every preset

    @property
    def measured(self) -> tuple[Run, ...]:
        """The runs that are evaluated: all but the shared first phase."""
        return tuple(run for run in self.runs if run.start)

    def run(self, name: str) -> Run:
        """The run of this name.

        Raises:
            ValueError: there is none; it names all.
        """
        found = {run.name: run for run in self.runs}
        if name not in found:
            raise ValueError(f"no run '{name}'; there are {', '.join(found)}")
        return found[name]


def _second(policy: str, preset: str, seeds: Sequence[int] = (0,)) -> list[Run]:
    return [Run(f"{policy}-s{seed}", policy, preset, seed, FIRST) for seed in seeds]


def _ablated(row: str) -> list[Run]:
    return _second(f"seek-{row.replace('_', '-')}", f"seek-small/{row}")


_SHARED = Run(FIRST, "", "sam2act-small", 0, "")
_CLOCKED = (
    *_second("seek-clock", f"seek-small{CLOCK}"),
    *_second("twin-clock", f"sam2act-small{CLOCK}"),
)
FULL = Study(
    name="full",
    runs=(
        _SHARED,
        *_second("seek", "seek-small", SEEDS),
        *_second("twin", "sam2act-small", SEEDS),
        *(run for row in ABLATED for run in _ablated(row)),
        *_CLOCKED,
    ),
    tasks=(),
    demonstrations={"train": None, "val": None},
    episodes=None,
    settings={},
)
TINY = Study(
    name="tiny",
    runs=(
        _SHARED,
        *_second("seek", "seek-small", SEEDS[:2]),
        *_second("twin", "sam2act-small"),
        *_ablated("scm"),
        *_second("twin-clock", f"sam2act-small{CLOCK}"),
    ),
    tasks=("push_button_times", "reopen_drawer", "search_cup_from_cabinet"),  # one a category
    demonstrations={"train": 2, "val": 1},
    episodes=1,
    settings={
        "model.views": {"size": 32, "points": 2048, "voxel": 0.02},
        "model.backbone": {"widths": [16, 32], "channels": 32, "depth": 1, "heads": 2},
        "model.language": {"channels": 16},
        "train": {"validate_episodes": 1},
        "train.first": {"steps": 12, "horizon": 12, "warmup": 2, "batch": 4},
        "train.second": {"steps": 6, "horizon": 6, "warmup": 2, "batch": 2, "frames": 3},
    },
)
STUDIES = {one.name: one for one in (FULL, TINY)}


def recipe(study: Study, run: Run) -> str | None:
    """The TOML that `hide train` takes for a run; None where its preset is all that it takes."""
    if not study.settings:
        return None
    head = [f'preset = "{run.preset}"', f'name = "{run.preset}"']
    return "\n".join([*head, *(_table(*table) for table in study.settings.items())]) + "\n"


def _table(name: str, settings: Settings) -> str:
    return "\n".join([f"[{name}]", *(f"{key} = {value}" for key, value in settings.items())])


def is_of(run: Run, config: Config) -> bool:
    """True if a checkpoint of this configuration may be the run's."""
    started = bool(config.train.start) == bool(run.start)
    return (config.name, config.train.seed, started) == (run.preset, run.seed, True)
