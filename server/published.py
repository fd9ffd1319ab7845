"""What the paper printed: its main table, measured in another simulator (RLBench on CoppeliaSim).

It is of suite `hide`, and never ranked with what is measured here. A task's figure is a percentage
of 25 test episodes; the averages are the paper's own.

Source: Shi et al., Benchmarking and Enhancing Skill-Level Memory for Partially Observable Robotic
Manipulation, table `tab:main_results`.
"""

from server.latex import COLUMNS
from server.schemas.leaderboard import PublishedPublic, PublishedRow

EPISODES = 25  # of each task
SIMULATOR = "RLBench (CoppeliaSim)"
SOURCE = "the paper's main table (tab:main_results): success rates in percent, 25 episodes a task"
METHODS: dict[str, tuple[bool, str]] = {  # memory-based; then the line as it is printed
    "OpenVLA": (False, "1.6 | 8 0 4 0 4 3.2 | 8 0 0 0 0 1.6 | 0 0 0 0 0 0.0"),
    "OpenVLA-OFT": (False, "13.9 | 12 0 28 0 0 8.0 | 36 0 68 0 32 27.2 | 0 4 0 28 0 6.4"),
    "π0": (False, "22.1 | 40 0 12 0 0 10.4 | 40 24 92 0 24 36.0 | 12 28 36 24 0 20.0"),
    "π0.5": (False, "14.4 | 16 0 4 4 4 5.6 | 20 8 76 0 20 24.8 | 4 8 20 32 0 12.8"),
    "GR00T-N1.7": (False, "26.4 | 12 0 12 4 4 6.4 | 96 0 84 0 68 49.6 | 28 16 40 24 8 23.2"),
    "RVT": (False, "35.7 | 68 12 20 40 48 37.6 | 28 24 80 0 60 38.4 | 40 12 44 60 0 31.2"),
    "RVT2": (False, "42.9 | 12 56 24 48 76 43.2 | 36 36 84 8 48 42.4 | 48 16 56 88 8 43.2"),
    "SAM2Act": (False, "42.7 | 16 56 12 48 76 41.6 | 8 32 100 4 52 39.2 | 48 24 64 84 16 47.2"),
    "μVLA": (True, "18.1 | 60 0 4 0 0 12.8 | 48 8 60 0 28 28.8 | 0 0 40 20 4 12.8"),
    "MME": (True, "18.4 | 0 0 4 0 8 2.4 | 100 4 56 0 16 35.2 | 16 16 28 28 0 17.6"),
    "SAM2Act+": (True, "51.2 | 32 52 32 48 68 46.4 | 8 28 96 28 72 46.4 | 52 8 72 100 72 60.8"),
    "SEEK": (True, "62.9 | 92 48 52 36 80 61.6 | 24 32 100 40 100 59.2 | 60 32 68 88 92 68.0"),
}


def published() -> PublishedPublic:
    """The paper's main table, in its order."""
    rows = [_row(name, memory, line) for name, (memory, line) in METHODS.items()]
    return PublishedPublic(
        source=SOURCE, simulator=SIMULATOR, comparable=False, episodes=EPISODES, rows=rows
    )


def _row(name: str, memory: bool, line: str) -> PublishedRow:
    overall, *groups = ([float(part) for part in group.split()] for group in line.split("|"))
    found = list(zip(COLUMNS.items(), groups, strict=True))
    return PublishedRow(
        method=name,
        memory_based=memory,
        tasks={
            task: value
            for (_, tasks), values in found
            for task, value in zip(tasks, values[:-1], strict=True)
        },
        categories={kind: values[-1] for (kind, _), values in found},
        overall=overall[0],
    )
