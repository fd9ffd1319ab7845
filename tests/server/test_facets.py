"""Facets: each count is what its filter finds, and respects the filters of other fields."""

from collections.abc import Iterator
from typing import Any

import pytest
from sqlalchemy.orm import Session

from hide_tasks.contract import EpisodeSpec, Failure
from server import episodes, facets, labels
from server.access import Principal, Role
from server.blobs import Blobs
from server.episode_order import Sort
from server.problems import Problem
from server.schemas.episodes import LabelCreate
from server.users import register_owner
from server.wanted import Wanted
from tests.server import ledgers

TASKS = ["push_button_times", "search_drawer"]
pytestmark = pytest.mark.usefixtures("on_each_database")


def outcome(spec: EpisodeSpec) -> Failure | None:
    if spec.index == 0:
        return Failure.OVERCOUNT
    return Failure.UNDERCOUNT if spec.index in (1, 2) else None


@pytest.fixture(scope="module")
def session(
    on_each_database: str,  # noqa: ARG001
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Session]:
    """Two policies' evaluations of two tasks, with labels on two episodes."""
    folder = tmp_path_factory.mktemp("facets")
    database = ledgers.opened(folder)
    for name in ("mine", "theirs"):
        ledgers.registered(database, name)
        store = Blobs(folder / "blobs")
        id = ledgers.evaluated(database, store, name, outcome, tasks=TASKS, episodes=6)
    with database.writing() as session:
        first, second, *_ = ledgers.episodes_of(session, id)
        owner = principal(session)
        labels.add(session, first, LabelCreate(label="gripper"), owner)
        labels.add(session, second, LabelCreate(note="The Lamp hides it; 50% dark"), owner)
        taken_back = labels.add(session, second, LabelCreate(label="wrong"), owner)
        labels.withdraw(session, taken_back.id, owner)
    with database.reading() as session:
        yield session
    database.close()


def principal(session: Session) -> Principal:
    owner = register_owner(session)
    return Principal(owner.id, owner.name, Role.ADMIN, Role.ADMIN.scopes, "local")


def ids(session: Session, **wanted: Any) -> list[str]:
    """Ids of the episodes of all pages, in order."""
    found, cursor = [], None
    while True:
        page = episodes.listed(session, limit=5, cursor=cursor, **wanted)
        found += [one.id for one in page.items]
        if (cursor := page.next) is None:
            return found


@pytest.mark.parametrize(
    "chosen",
    [
        {},
        {"verdict": "inexact"},
        {"task": "push_button_times"},
        {"task": "push_button_times", "hidden": "presses_done=3", "verdict": ["failed"]},
        {"task": "push_button_times", "variation": "count=2", "failure": "undercount"},
        {"policy": "mine@1", "category": "EPT"},
        {"text": "push button"},
    ],
)
def test_a_count_is_what_its_filter_finds(session: Session, chosen: dict[str, Any]) -> None:
    wanted = Wanted(**chosen)
    found = facets.facets(session, wanted)

    assert found.episodes == len(ids(session, **chosen))
    for name, values in found.facets.items():
        others = Wanted(**chosen).without(name).model_dump(exclude_defaults=True)
        for one in values:
            if name in ("hidden", "variation") and getattr(wanted, name):
                continue  # other names of the same field still narrow
            assert one.episodes == len(ids(session, **(others | {name: one.value}))), (name, one)


def test_counts_of_a_field_do_not_heed_its_own_filter(session: Session) -> None:
    plain, chosen = (
        facets.facets(session, Wanted(failure=failure, task="search_drawer")).facets
        for failure in (None, "overcount")
    )

    assert plain["failure"] == chosen["failure"]
    assert sum(one.episodes for one in chosen["policy"]) == 2


def test_values_of_another_axis_narrow_and_those_of_the_same_do_not(session: Session) -> None:
    found = facets.facets(session, Wanted(task="push_button_times", variation=["count=2"])).facets
    counts = {one.value: one.episodes for one in found["variation"]}

    assert sum(n for name, n in counts.items() if name.startswith("count=")) == 12
    assert sum(n for name, n in counts.items() if name.startswith("color=")) == counts["count=2"]


def test_hidden_values_and_axes_are_counted_for_one_task_alone(session: Session) -> None:
    one = facets.facets(session, Wanted(task="search_drawer")).facets
    two = facets.facets(session, Wanted(task=TASKS)).facets

    assert [value.value for value in one["hidden"]] == ["item_in=top", "presses_done=3"]
    assert "hidden" not in two and "variation" not in two


def test_several_values_of_a_field_are_alternatives(session: Session) -> None:
    both = ids(session, failure=["overcount", "undercount"])

    assert set(both) == set(ids(session, failure="overcount") + ids(session, failure="undercount"))
    assert len(both) == 12 and len(ids(session, task=TASKS, policy=["mine", "theirs"])) == 24


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("do push_button_times", 12),
        ("PUSH do", 12),
        ("lamp", 1),
        ("50% dark", 1),
        ("5_%", 0),
        ("lamp nowhere", 0),
    ],
)
def test_all_words_are_looked_for(session: Session, text: str, count: int) -> None:
    assert len(ids(session, text=text)) == count


def test_labels_that_stand_are_counted(session: Session) -> None:
    found = facets.facets(session, Wanted()).facets["label"]

    assert [(one.value, one.episodes) for one in found] == [("gripper", 1)]
    assert len(ids(session, labelled=True)) == 2 and len(ids(session, labelled=False)) == 22
    assert len(ids(session, label="wrong")) == 0


@pytest.mark.parametrize("sort", list(Sort))
def test_neighbours_walk_the_list(session: Session, sort: Sort) -> None:
    wanted = {"verdict": "inexact", "task": "push_button_times"}
    there = ids(session, sort=sort, **wanted)

    for n, id in enumerate(there):
        before = there[n - 1] if n else None
        after = there[n + 1] if n + 1 < len(there) else None
        assert episodes.beside(session, id, sort=sort, **wanted) == (before, after)


def test_an_episode_that_is_not_wanted_has_no_neighbours(session: Session) -> None:
    [other, *_] = ids(session, verdict="exact")

    assert episodes.beside(session, other, verdict="inexact") is None


def test_an_unknown_task_or_axis_is_told_with_what_is_right() -> None:
    with pytest.raises(Problem, match="search_drawer"):
        Wanted(task="serch_drawer").require_known()
    with pytest.raises(Problem, match="there are item_in"):
        Wanted(task="search_drawer", variation="count=3").require_known()
