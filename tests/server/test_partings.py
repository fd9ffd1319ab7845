"""Where two runs of the same episode part."""

from pathlib import Path
from typing import Any

import pytest
from sqlalchemy.orm import Session

from hide_tasks.contract import EEDelta, Keyframe, MotionOutcome
from server import episodes, partings
from server.blobs import Blobs
from server.schemas.episodes import DecisionPublic
from tests.server import ledgers

STRAIGHT = (0.0, 1.0, 0.0, 0.0)


def run(*places: float, **last: Any) -> list[DecisionPublic]:
    """One decision a place, the last with other fields."""
    found = [decision(number, place) for number, place in enumerate(places)]
    found[-1] = found[-1].model_copy(update=last)
    return found


def decision(number: int, x: float, **fields: Any) -> DecisionPublic:
    known: dict[str, Any] = {
        "decision": number,
        "time": 1.5 * (number + 1),
        "action": Keyframe(position=(x, 0.0, 1.0), quaternion=STRAIGHT),
        "outcome": MotionOutcome.ARRIVED,
        "stage": f"press {number}",
        "hidden": {"presses_done": number},
        "checks": {},
        "success": False,
    }
    return DecisionPublic.model_validate(known | fields)


def keyframe(x: float = 0.2, **fields: Any) -> Keyframe:
    known: dict[str, Any] = {"position": (x, 0.0, 1.0), "quaternion": STRAIGHT}
    return Keyframe.model_validate(known | fields)


def test_runs_that_are_alike_do_not_part() -> None:
    found = partings.between(run(0.1, 0.2), run(0.11, 0.21))

    assert found.decision is None


@pytest.mark.parametrize(
    ("last", "why"),
    [
        ({"action": keyframe(0.4)}, "20 cm away"),
        ({"action": keyframe(opening=0.0)}, "fingers were closed"),
        ({"action": keyframe(stop=True)}, "It stopped"),
        ({"action": keyframe(quaternion=(0.0, 1.0, 0.0, 1.0))}, "turned the gripper 90°"),
        ({"outcome": MotionOutcome.NO_PATH}, "no path"),
        ({"hidden": {"presses_done": 4}}, "presses done was 4, with the other 1"),
        ({"stage": "withdraw"}, "called for “withdraw”"),
    ],
)
def test_the_first_difference_is_named(last: dict[str, Any], why: str) -> None:
    found = partings.between(run(0.1, 0.2, **last), run(0.1, 0.2))

    assert (found.decision, found.time_a, found.time_b) == (1, 1.5, 1.5)
    assert why in found.why


def test_a_gripper_turned_by_half_is_the_same() -> None:
    turned = {"action": keyframe(quaternion=(1.0, 0.0, 0.0, 0.0))}

    assert partings.between(run(0.1, 0.2, **turned), run(0.1, 0.2)).decision is None


@pytest.mark.parametrize(("a", "b"), [((0.1,), (0.1, 0.2)), ((0.1, 0.2), (0.1,)), ((), (0.1,))])
def test_a_run_that_ends_sooner_parts_there(a: tuple[float, ...], b: tuple[float, ...]) -> None:
    found = partings.between(run(*a) if a else [], run(*b))

    assert found.decision == min(len(a), len(b))
    assert ("It ended" in found.why) == (len(a) < len(b))


def test_chunks_are_compared_by_what_became_of_the_world() -> None:
    chunk = EEDelta(chunk=((0.0,) * 7,))
    still = {"stage": "press 0", "hidden": {"presses_done": 0}}
    dense = [
        decision(0, 0.1, action=chunk, **still),
        decision(1, 0.1, action=chunk, **still),
        decision(2, 0.1, action=chunk, stage="press 1", hidden={"presses_done": 2}),
    ]

    found = partings.between(dense, run(0.1, 0.2))

    assert (found.decision, found.other_decision) == (2, 1)
    assert (found.time_a, found.time_b) == (3.0, 1.5)


def test_an_episode_is_held_against_the_experts_newest_run(tmp_path: Path) -> None:
    database, store = ledgers.opened(tmp_path), Blobs(tmp_path / "blobs")
    ledgers.evaluated(database, store, "expert", tasks=["search_drawer"], episodes=2)
    newest = ledgers.evaluated(database, store, "expert", tasks=["search_drawer"], episodes=1)
    noop = ledgers.evaluated(database, store, "noop", tasks=["search_drawer"], episodes=3)

    with database.reading() as session:
        first, second, third = (one.id for one in ledgers.episodes_of(session, noop))
        found = partings.from_expert(session, [first, second, third])
        runs = partings.runs_of_same(session, first)

        assert found[first].other == _first(session, newest)
        assert set(found) == {first, second}
        assert [one.policy for one in runs] == ["expert"]
        assert runs[0].episode == _first(session, newest)
        assert episodes.decisions_of(session, [first])[first] == episodes.decisions(session, first)
    database.close()


@pytest.mark.usefixtures("on_each_database")
def test_a_later_run_of_something_else_hides_no_run_of_the_same(tmp_path: Path) -> None:
    database, store = ledgers.opened(tmp_path), Blobs(tmp_path / "blobs")
    noop = ledgers.evaluated(database, store, "noop", tasks=["search_drawer"], episodes=2)
    expert = ledgers.evaluated(database, store, "expert", tasks=["search_drawer"], episodes=2)
    ledgers.evaluated(database, store, "expert", tasks=["search_boxes"], episodes=2)
    ledgers.evaluated(database, store, "expert", tasks=["search_drawer"], episodes=1)

    with database.reading() as session:
        second = ledgers.episodes_of(session, noop)[1]
        runs = partings.runs_of_same(session, second.id)

        assert [run.evaluation for run in runs] == [expert]
    database.close()


def _first(session: Session, evaluation: str) -> str:
    return ledgers.episodes_of(session, evaluation)[0].id
