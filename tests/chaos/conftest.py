"""One system of each engine, which all tests of what goes wrong share; each leaves it whole."""

import sys
from collections.abc import Iterator
from typing import Any

import pytest

from tests.chaos.systems import MOMENTS, SYSTEMS, System, marks_of


def is_long(name: str) -> bool:
    """`make test` kills in the middle of an episode, of a cluster what only a cluster has."""
    if "test_a_part_is_killed" in name:
        below = "dask-policy" in name or "dask-simulator" in name or "dask-supervisor" in name
        return below or MOMENTS[1] not in name
    return "full_disk" not in name and "clock" not in name


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if "/tests/chaos/" in item.path.as_posix():
            item.add_marker(pytest.mark.slow)
            item.add_marker(pytest.mark.timeout(900))
            if is_long(item.name):
                item.add_marker(pytest.mark.long)
            on_linux = sys.platform == "linux"
            item.add_marker(pytest.mark.skipif(not on_linux, reason="looks into /proc"))


@pytest.fixture(
    scope="session", params=[pytest.param(name, marks=marks_of(name)) for name in SYSTEMS]
)
def system(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[System]:
    """A running system."""
    with SYSTEMS[request.param](tmp_path_factory.mktemp(request.param)) as running:
        yield running


@pytest.fixture(scope="session")
def undisturbed(system: System) -> dict[int, tuple[Any, ...]]:
    """What is measured where nothing goes wrong, by index."""
    evaluation = system.ask()
    assert system.finished(evaluation)["state"] == "completed"
    assert system.lost(evaluation) == []
    scores = system.scores(evaluation)
    assert len(scores) == 2
    return scores


@pytest.fixture
def disturbed(system: System) -> Iterator[System]:
    """A running system. Whatever a test does to it, what was committed stays, and no litter."""
    before = system.committed()
    yield system
    system.release()
    assert before.items() <= system.committed().items()
    assert system.divergences() == 0
    assert system.litter() == []
    assert system.orphans() == set()
