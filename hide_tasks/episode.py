"""Plays one episode: the loop, the two verdicts, the names of what went wrong."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from hide_tasks import load, suite
from hide_tasks.bullet.fingerprint import final_state_hash
from hide_tasks.bullet.scene import Part
from hide_tasks.bullet.world import World
from hide_tasks.contract import (
    Belief,
    DecisionRecord,
    EEDelta,
    EpisodeResult,
    EpisodeSpec,
    Failure,
    InvalidAction,
    JointPosition,
    Observation,
    Policy,
    PolicyFailure,
    Rules,
    Start,
    Timing,
    parse_action,
)

FURTHER = 3  # decisions after success through which it must hold to be exact
PARITY_BUDGET = 25  # decisions, as PerAct's evaluations have

Answer = TypeVar("Answer")


class Witness(Protocol):
    """Whoever records an episode."""

    def begin(
        self, spec: EpisodeSpec, instruction: str, parts: Sequence[Part], start: Start
    ) -> None:
        """The episode starts; `parts` is what will be drawn."""

    def frame(self, time: float, poses: NDArray[np.float64]) -> None:
        """20 times a simulated second: the world transforms (n, 4, 4) of the parts."""

    def decided(self, observation: Observation, record: DecisionRecord) -> None:
        """The observation before an action and the record after it."""

    def end(self, result: EpisodeResult, observation: Observation) -> None:
        """The verdict and the last picture."""


@dataclass
class Episode:
    """An episode under way."""

    spec: EpisodeSpec
    world: World
    policy: Policy
    rules: Rules
    witnesses: Sequence[Witness]
    budget: int  # decisions
    records: list[DecisionRecord] = field(default_factory=list)
    success_at: int | None = None  # the number of decisions when the checks first held
    rows: int = 0  # of dense actions, at 20 Hz
    policy_seconds: float = 0.0

    def play(self) -> tuple[Failure | None, str]:
        """Play to the end; the policy's failure and its message, if it failed."""
        try:
            instruction, seed = self.world.task.instruction, suite.policy_seed(self.spec)
            self.ask(lambda: self.policy.reset(instruction, seed))
            while not self.over():
                self.decide()
        except PolicyFailure as error:
            return error.failure, str(error)
        return None, ""

    def decide(self) -> None:
        """One decision: look, ask, act, record."""
        observation = self.world.observe()
        action = self.ask(lambda: parse_action(self.policy.act(observation)))
        belief = self.ask(lambda: _belief(self.policy))
        if isinstance(action, JointPosition | EEDelta):
            self.rows += len(action.chunk)
        known = len(self.world.events), len(self.world.violations)
        motion = self.world.execute(action)
        if self.world.success and self.success_at is None:
            self.success_at = len(self.records) + 1
        record = DecisionRecord(
            decision=len(self.records),
            time=round(self.world.time, 6),
            action=action,
            outcome=motion.outcome,
            retried=motion.retried,
            path=motion.path,
            stage=self.world.task.stage(),
            hidden=self.world.task.hidden_state(),
            checks=self.world.task.checks(),
            success=self.world.success,
            events=self.world.events[known[0] :],
            violations=self.world.violations[known[1] :],
            belief=belief,
        )
        self.records.append(record)
        for witness in self.witnesses:
            witness.decided(observation, record)

    def ask(self, question: Callable[[], Answer]) -> Answer:
        """The policy's answer; whatever goes wrong in it gets its name."""
        start = perf_counter()
        try:
            return question()
        except PolicyFailure:
            raise
        except (InvalidAction, ValidationError) as error:
            raise PolicyFailure(Failure.POLICY_INVALID, str(error)) from error
        except Exception as error:
            message = f"{type(error).__name__}: {error}"
            raise PolicyFailure(Failure.POLICY_ERROR, message) from error
        finally:
            self.policy_seconds += perf_counter() - start

    def over(self) -> bool:
        """True when nothing that may still happen would change a verdict."""
        done = len(self.records)
        if done and self.records[-1].action.stop:
            return True
        if self.success_at is not None:
            further = 0 if self.rules == "parity" else FURTHER
            return done >= self.success_at + further or self.spent()
        spoiled = self.world.task.spoils.intersection(self.world.violations)
        return self.spent() or bool(spoiled)

    def spent(self) -> bool:
        """True when the budget is used up: decisions, or rows of dense actions."""
        if self.rows:
            return self.rows >= suite.row_budget(self.spec.task)
        return len(self.records) >= self.budget

    def spent_in_vain(self) -> str:
        """Says so if the budget ran out before a verdict was reached."""
        stopped = bool(self.records) and self.records[-1].action.stop
        if not self.spent() or stopped or self.success_at is not None:
            return ""
        spent = f"{self.rows} rows of dense actions" if self.rows else f"{self.budget} decisions"
        return f"The budget of {spent} is spent."

    def failure(self) -> Failure | None:
        """Why the episode is not exact; None if it is."""
        if self.world.violations:
            return self.world.violations[0]
        if self.world.success and all(self.world.task.checks().values()):
            return None
        if self.records and self.records[-1].outcome.failed:
            return Failure.UNREACHABLE_POSE
        return self.world.task.missing()


def budget_of(spec: EpisodeSpec, rules: Rules) -> int:
    """How many decisions an episode may take."""
    return PARITY_BUDGET if rules == "parity" else load(spec.task).budget()


def play(
    spec: EpisodeSpec,
    policy: Policy,
    *,
    rules: Rules = "hide",
    witnesses: Sequence[Witness] = (),
    budget: int | None = None,
) -> tuple[EpisodeResult, list[DecisionRecord]]:
    """Play an episode in this process; its result and one record per decision.

    `budget` replaces the task's; results that count never do that.
    """
    began = perf_counter()
    with World(suite.build(spec), witnesses) as world:
        start = Start(
            stage=world.task.stage(), hidden=world.task.hidden_state(), checks=world.task.checks()
        )
        for witness in witnesses:
            witness.begin(spec, world.task.instruction, world.parts, start)
            witness.frame(0.0, world.poses())
        if hasattr(policy, "bind"):
            policy.bind(world, spec)
        episode = Episode(spec, world, policy, rules, witnesses, budget or budget_of(spec, rules))
        fault, detail = episode.play()
        failure = fault or episode.failure()
        result = EpisodeResult(
            **spec.model_dump(include={"task", "split", "index", "variation"}),
            instruction=world.task.instruction,
            success=world.success,
            exact=failure is None,
            failure=failure,
            detail=detail or episode.spent_in_vain(),
            decisions=len(episode.records),
            stage=world.task.stage(),
            scene_hash=world.task.layout.scene_hash(world.task.instruction),
            final_state_hash=final_state_hash(world),
            timing=_timing(episode, perf_counter() - began),
        )
        if witnesses:
            last = world.observe()
            for witness in witnesses:
                witness.end(result, last)
    return result, episode.records


def _timing(episode: Episode, total: float) -> Timing:
    world = episode.world
    return Timing(
        **world.seconds,
        planning=world.executor.planning_seconds,
        policy=episode.policy_seconds,
        total=total,
        steps=world.steps,
        renders=world.renders,
    )


def _belief(policy: Policy) -> Belief | None:
    said = policy.belief() if hasattr(policy, "belief") else None
    return None if said is None else Belief.model_validate(said)
