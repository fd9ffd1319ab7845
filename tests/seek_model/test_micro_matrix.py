"""The committed matrix of micro-tasks: it belongs to these settings, and memory explains it."""

from pathlib import Path

import pytest

from seek_model.micro_matrix import ALL, MEMORIES, Matrix, Schedule, model, opened
from seek_model.micro_tasks import CHANCE, TASKS

FILE = Path(__file__).parents[2] / "docs" / "micro_matrix.json"
NEEDED = {"repeat": "scm", "cue": "pam", "outcome": "wcm"}  # the memory that a task is made for
SEEDS = 3
NEAR_CHANCE = 0.12
SOLVED = 0.85


@pytest.fixture(scope="module")
def matrix() -> Matrix:
    return Matrix.model_validate_json(FILE.read_text())


def accuracy(matrix: Matrix, memory: str, task: str) -> float:
    cells = [one for one in matrix.cells if one.memory == memory]
    return sum(one.scores[task].accuracy for one in cells) / len(cells)


def test_it_was_made_with_the_present_settings(matrix: Matrix) -> None:
    assert matrix.schedule == Schedule()
    assert matrix.model == model(ALL)
    assert matrix.chance == CHANCE


def test_every_memory_was_trained_with_every_seed(matrix: Matrix) -> None:
    trained = {(one.memory, one.seed) for one in matrix.cells}

    assert trained >= {(name, seed) for name in MEMORIES for seed in range(SEEDS)}


@pytest.mark.parametrize("task", TASKS)
def test_all_memories_together_solve_a_task(matrix: Matrix, task: str) -> None:
    assert accuracy(matrix, "wcm+pam+scm", task) >= SOLVED


@pytest.mark.parametrize("task", TASKS)
def test_without_memory_a_task_is_left_to_chance(matrix: Matrix, task: str) -> None:
    assert abs(accuracy(matrix, "none", task) - CHANCE[task]) <= NEAR_CHANCE


@pytest.mark.parametrize("task", TASKS)
def test_the_memory_that_a_task_is_made_for_solves_it_and_no_other_does(
    matrix: Matrix, task: str
) -> None:
    alone = {name: accuracy(matrix, name, task) for name in ("scm", "pam", "wcm")}

    assert alone.pop(NEEDED[task]) >= SOLVED
    assert max(alone.values()) - CHANCE[task] <= NEAR_CHANCE


def test_where_nothing_is_hidden_every_network_is_right(matrix: Matrix) -> None:
    for cell in matrix.cells:
        for score in cell.scores.values():
            assert score.visible >= SOLVED, (cell.memory, cell.seed)


def test_a_file_of_other_settings_is_not_gone_on_with(tmp_path: Path, matrix: Matrix) -> None:
    file = tmp_path / "matrix.json"
    file.write_text(matrix.model_dump_json())

    with pytest.raises(SystemExit, match="made with other settings"):
        opened(file, Schedule(episodes=7))
