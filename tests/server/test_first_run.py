from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from hide_tasks.contract import Failure
from server.first_run import evaluate_all, policies, tables, where_to_look
from tests.workers.test_run_folder import TASKS, play, result, wanted
from workers.results import Results


def shown(runs: dict[str, Results], width: int = 160) -> str:
    console = Console(width=width, record=True, file=StringIO())
    for table in tables(runs, width):
        console.print(table)
    return console.export_text()


@pytest.mark.slow
def test_the_built_in_policies_of_one_episode(tmp_path: Path) -> None:
    runs = evaluate_all(tmp_path, TASKS[:1], episodes=1)

    verdicts = {name: run.episodes[0].exact for name, run in runs.items()}
    assert (verdicts["expert"], verdicts["replay"], verdicts["noop"]) == (True, True, False)
    assert list(runs) == list(policies(tmp_path))
    assert all(
        (tmp_path / name / str(run.episodes[0].recording)).exists() for name, run in runs.items()
    )
    command = where_to_look(runs, tmp_path).splitlines()[-1].split()
    assert len(command) == 3
    assert all(Path(part).exists() for part in command)


def test_the_table_has_policies_below_and_tasks_beside_each_other() -> None:
    good = wanted().with_episode(result(TASKS[0], 0))
    bad = wanted().with_episode(
        result(TASKS[0], 0).model_copy(update={"exact": False, "failure": Failure.OVERCOUNT})
    )

    text = shown({"expert": good, "amnesiac": bad})

    assert text.index(TASKS[0]) < text.index(TASKS[1]) < text.index("overall")
    assert text.index("expert") < text.index("amnesiac") < text.index("best without")
    assert "100 % [20, 100]" in text
    assert "n=1 of 6" in text


def test_on_a_narrow_screen_no_number_is_cut_off() -> None:
    full = wanted().with_episode(result(TASKS[0], 0)).with_episode(result(TASKS[1], 0))

    text = shown({"expert": full}, width=70)

    assert text.count("overall") == 2
    assert text.count("100 % [20, 100]") == 4
    assert text.count("100 % [34, 100]") == 4


def test_a_run_that_is_there_is_not_played_again(tmp_path: Path) -> None:
    for name, policy in policies(tmp_path).items():
        play(tmp_path / name, (TASKS[0], 0), policy=policy, tasks=TASKS[:1],
             budgets={TASKS[0]: 25}, planned={TASKS[0]: 1})  # fmt: skip

    runs = evaluate_all(tmp_path, TASKS[:1], episodes=1)

    assert all(run.episodes[0].scene_hash == "a" for run in runs.values())
