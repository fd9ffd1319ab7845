"""Swapping the rings: either order, the stop, wrong pegs, too many moves, a ring that fell."""

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure, Stop
from hide_tasks.episode import play
from hide_tasks.motion.general import home
from hide_tasks.poses import pose

SPEC = suite.episode("swap_square_pegs", "val", 0)
RED, BLUE = SPEC.variation["red_and_blue_on"].split()
(SPARE,) = {"left", "middle", "right"} - {RED, BLUE}
SWAP = ((RED, SPARE), (BLUE, RED), (SPARE, BLUE))


class Carrier:
    """Carries rings from peg to peg, then stops."""

    def __init__(self, *carries, keyframes=None):
        self.carries, self.keyframes = carries, keyframes

    def bind(self, world, spec):
        task = world.task
        moves = [move for way in self.carries for move in (*task._carry(*way), home())]
        self.left = iter(moves[: self.keyframes])

    def reset(self, instruction, policy_seed):
        """The way is all it has."""

    def act(self, observation):
        move = next(self.left, None)
        return move() if move else Stop()


def verdict(*carries, keyframes=None):
    result, _ = play(SPEC, Carrier(*carries, keyframes=keyframes))
    return result.success, result.exact, result.failure


def test_either_ring_may_go_first():
    assert verdict((BLUE, SPARE), (RED, BLUE), (SPARE, RED)) == (True, True, None)


def test_who_goes_on_instead_of_stopping_has_swapped_but_not_exactly():
    assert verdict(*SWAP, (BLUE, SPARE)) == (True, False, Failure.NOT_PLACED)


def test_three_moves_to_wrong_pegs_are_a_wrong_recall():
    carries = ((RED, SPARE), (SPARE, RED), (RED, SPARE))

    assert verdict(*carries) == (False, False, Failure.WRONG_RECALL)


def test_a_fourth_move_ends_it():
    result, records = play(SPEC, Carrier(*[(RED, SPARE), (SPARE, RED)] * 3))

    assert (result.success, result.failure) == (False, Failure.REPEATED_STEP)
    assert len(records) == 3 * 6 + 5


def test_taking_hold_again_is_no_move():
    with World(suite.build(SPEC)) as world:
        for move in world.task._carry(RED, RED):
            world.execute(move())
        again = world.task.moves
        for move in world.task._carry(RED, SPARE):
            world.execute(move())

        assert (again, world.task.moves) == (0, 1)


def test_the_stage_follows_the_ring_that_went_first():
    with World(suite.build(SPEC)) as world:
        for move in world.task._carry(BLUE, SPARE):
            world.execute(move())

        assert world.task.stage() == f"red from {RED} to {BLUE}"


def test_two_moves_are_not_all():
    assert verdict(*SWAP[:2]) == (False, False, Failure.UNFINISHED)


def test_a_ring_in_the_hand_is_not_placed():
    assert verdict(*SWAP, keyframes=3) == (False, False, Failure.NOT_PLACED)


def test_a_ring_beside_the_table_has_fallen():
    with World(suite.build(SPEC)) as world:
        for seat in world.task.layout.seats:
            seat.taken = False
        world.task.red.body.place(pose(0.3, 1.2, 0.6))

        assert world.task.violations() == [Failure.DROPPED_OBJECT]
