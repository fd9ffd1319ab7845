"""Plays an episode again from its recorded actions; what was recorded is held against it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from hide_tasks.contract import (
    Action,
    DecisionRecord,
    EpisodeResult,
    EpisodeSpec,
    Failure,
    Observation,
    PolicyFailure,
    Rules,
)
from workers.protocol import HiddenChange

OUT_OF_ACTIONS = "The recorded actions are used up, and the episode is not over."


@dataclass(frozen=True)
class Recorded:
    """What is played again; small enough to be sent to another process."""

    key: str  # whoever asks knows it by this
    spec: EpisodeSpec
    rules: Rules
    actions: tuple[Action, ...]
    fault: Failure | None = None  # what ended it, if the policy failed


@dataclass(frozen=True)
class Resimulated:
    """What came of it."""

    result: EpisodeResult
    decisions: tuple[DecisionRecord, ...]
    changes: tuple[HiddenChange, ...]


class Repeat:
    """Repeats recorded actions, then fails as the policy did.

    Where it did not, and is asked all the same, it fails too: the record is not of this episode.
    """

    def __init__(self, actions: Sequence[Action], fault: Failure | None):
        self.actions, self.fault = actions, fault

    def reset(self, instruction: str, policy_seed: int) -> None:
        """Back to the first action."""
        self.left = iter(self.actions)

    def act(self, observation: Observation) -> Any:
        """The next recorded action.

        Raises:
            PolicyFailure: there is none.
        """
        for action in self.left:
            return action
        raise PolicyFailure(self.fault or Failure.POLICY_ERROR, OUT_OF_ACTIONS)


def resimulate(recorded: Recorded) -> Resimulated:
    """Plays an episode in this process.

    Raises:
        Exception: the simulator failed.
    """
    from hide_tasks.episode import play  # only a process that plays pays for the simulator
    from workers.hidden_trace import HiddenTrace

    trace = HiddenTrace()
    policy = trace.watching(Repeat(recorded.actions, recorded.fault))
    result, decisions = play(recorded.spec, policy, rules=recorded.rules, witnesses=[trace])
    return Resimulated(result, tuple(decisions), tuple(trace.changes))
