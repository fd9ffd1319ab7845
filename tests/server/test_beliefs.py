"""What a policy believed against what was true, and how an episode is played again."""

from collections.abc import Iterator

import pytest

from hide_tasks.contract import Belief
from server import beliefs, episodes
from server.blobs import Blobs
from server.db import Database
from server.schemas.episodes import DecisionPublic, EpisodeDetail
from tests.server import ledgers


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Database]:
    """With an episode of which three presses were asked, one at each of its three decisions."""
    folder = tmp_path_factory.mktemp("beliefs")
    found = ledgers.opened(folder)
    wanted = {"tasks": ["push_button_times"], "episodes": 5}
    ledgers.evaluated(found, Blobs(folder / "blobs"), **wanted)
    yield found
    found.close()


def believing(
    database: Database, *counts: int | None
) -> tuple[EpisodeDetail, list[DecisionPublic]]:
    """The episode with these counts said at its decisions; it is known at the expert's moments."""
    with database.reading() as session:
        found = episodes.listed(session).items
        [one] = [one for one in found if one.variation["count"] == 5]
        episode, decisions = episodes.get(session, one.id), episodes.decisions(session, one.id)
    assert episode.start
    start = episode.start.model_copy(update={"stage": "reach", "hidden": {"presses_done": 0}})
    pressed = [{"stage": "press", "hidden": {"presses_done": n}} for n in (1, 2, 7)]
    changed = zip(decisions, pressed, counts, strict=True)
    return episode.model_copy(update={"start": start}), [
        one.model_copy(update={**so, "belief": None if n is None else Belief(stage_count=n)})
        for one, so, n in changed
    ]


def test_a_count_is_held_against_what_was_true_when_it_was_stated(database: Database) -> None:
    found = beliefs.checked(*believing(database, 1, 3, 2))

    assert [one.true for one in found.decisions] == [[0, 1], [1, 2], [2, 3]]
    assert [one.right for one in found.decisions] == [True, False, True]
    assert (found.stated, found.checked, found.right) == (3, 3, 2)


def test_a_decision_without_a_count_is_not_judged(database: Database) -> None:
    found = beliefs.checked(*believing(database, None, 1, None))

    assert [one.decision for one in found.decisions] == [1]
    assert (found.stated, found.checked, found.right) == (1, 1, 1)


def test_nothing_is_judged_where_no_expert_comes(database: Database) -> None:
    episode, decisions = believing(database, 0, 0, 0)
    beyond = decisions[0].model_copy(update={"hidden": {"presses_done": 9}})

    found = beliefs.checked(episode, [beyond, *decisions[1:]])

    assert [one.right for one in found.decisions] == [True, None, False]
    assert (found.stated, found.checked, found.right) == (3, 2, 1)


def test_an_episode_that_was_not_played_states_nothing(database: Database) -> None:
    episode, _ = believing(database, 0, 0, 0)

    assert beliefs.checked(episode.model_copy(update={"start": None}), []).stated == 0
