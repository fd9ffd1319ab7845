"""What is special to the buttons of the real robot."""

from hide_tasks import load, suite
from hide_tasks.contract import Failure
from hide_tasks.episode import play
from hide_tasks.policies import Expert, Replay

SPEC = suite.episode("real_push_button_times", "val", 0).twin({"count": 2})


def test_it_is_seen_by_one_camera_and_has_the_papers_counts():
    task = load(SPEC.task)

    assert task.cameras == ("front",)
    assert (task.axes()["count"], task.keyframes) == ((1, 2, 3), {4, 6, 8})


def test_the_three_buttons_have_three_colours():
    task = suite.build(SPEC)

    buttons = [task.target, *task.distractors]
    assert {button.color for button in buttons} == set(task.palette)
    assert task.target.color == SPEC.variation["color"]


def test_a_press_too_many_and_one_too_few_are_named():
    actions = [record.action for record in play(SPEC, Expert())[1]]
    more, _ = play(SPEC.twin({"count": 1}), Replay(actions))
    fewer, _ = play(SPEC.twin({"count": 3}), Replay(actions))

    assert (more.exact, more.failure) == (False, Failure.OVERCOUNT)
    assert (fewer.success, fewer.failure) == (False, Failure.UNDERCOUNT)
