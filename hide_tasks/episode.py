"""Plays one episode: the loop, the two verdicts, the names of what went wrong."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import TypeVar

from pydantic import ValidationError

from hide_tasks import load, suite
from hide_tasks.bullet.fingerprint import final_state_hash
from hide_tasks.bullet.world import World
from hide_tasks.contract import (
    Action,
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
from hide_tasks.witness import Audience, Witness

FURTHER = 3  # decisions after success through which it must hold to be exact
PARITY_BUDGET = 25  # decisions, as PerAct's evaluations have

Answer = TypeVar("Answer")


@dataclass
class Episode:
    """An episode under way. Whoever plays it looks, then takes an action, until it is over."""

    spec: EpisodeSpec
    world: World
    rules: Rules
    budget: int  # decisions
    witnesses: Sequence[Witness] = ()
    records: list[DecisionRecord] = field(default_factory=list)
    success_at: int | None = None  # the number of decisions when the checks first held
    rows: int = 0  # of dense actions, at 20 Hz

    def begin(self) -> None:
        """Tell the witnesses what there is to see."""
        task = self.world.task
        start = Start(stage=task.stage(), hidden=task.hidden_state(), checks=task.checks())
        for witness in self.witnesses:
            witness.begin(self.spec, task.instruction, self.world.parts, start)
            witness.frame(0.0, self.world.poses())

    def take(
        self, observation: Observation, action: Action, belief: Belief | None = None
    ) -> DecisionRecord:
        """One decision: carry out the action that an observation was answered with."""
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
        return record

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

    def result(
        self, fault: Failure | None = None, detail: str = "", timing: Timing | None = None
    ) -> EpisodeResult:
        """The verdicts as things stand; `fault` is the policy's, if it failed."""
        task = self.world.task
        failure = fault or self.failure()
        return EpisodeResult(
            **self.spec.model_dump(include={"task", "split", "index", "variation"}),
            instruction=task.instruction,
            success=self.world.success,
            exact=failure is None,
            failure=failure,
            detail=detail or self.spent_in_vain(),
            decisions=len(self.records),
            stage=task.stage(),
            scene_hash=task.layout.scene_hash(task.instruction),
            final_state_hash=final_state_hash(self.world),
            timing=timing or Timing(),
        )

    def end(self, result: EpisodeResult) -> None:
        """Tell the witnesses the verdicts."""
        if self.witnesses:
            last = self.world.observe()
            for witness in self.witnesses:
                witness.end(result, last)


@dataclass
class Player:
    """A policy that is asked; whatever goes wrong in it gets its name."""

    policy: Policy
    seconds: float = 0.0  # that its answers took

    def play(self, episode: Episode) -> tuple[Failure | None, str]:
        """Play to the end; the policy's failure and its message, if it failed."""
        try:
            instruction, seed = episode.world.task.instruction, suite.policy_seed(episode.spec)
            self.ask(lambda: self.policy.reset(instruction, seed))
            while not episode.over():
                self.decide(episode)
        except PolicyFailure as error:
            return error.failure, str(error)
        return None, ""

    def decide(self, episode: Episode) -> None:
        """One decision: look, ask, act."""
        observation = episode.world.observe()
        action = self.ask(lambda: parse_action(self.policy.act(observation)))
        episode.take(observation, action, self.ask(lambda: _belief(self.policy)))

    def ask(self, question: Callable[[], Answer]) -> Answer:
        """The policy's answer.

        Raises:
            PolicyFailure: it gave none.
        """
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
            self.seconds += perf_counter() - start


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
    audience = Audience(witnesses)
    heard = [audience] if witnesses else []
    with World(suite.build(spec), heard) as world:
        episode = Episode(spec, world, rules, budget or budget_of(spec, rules), heard)
        episode.begin()
        if hasattr(policy, "bind"):
            policy.bind(world, spec)
        player = Player(policy)
        fault, detail = player.play(episode)
        total = perf_counter() - began
        timing = _timing(world, player.seconds, audience.seconds, total)
        result = episode.result(fault, detail, timing)
        episode.end(result)
    return result, episode.records


def _timing(world: World, policy: float, recording: float, total: float) -> Timing:
    return Timing(
        **world.seconds,
        planning=world.executor.planning_seconds,
        policy=policy,
        recording=recording,
        total=total,
        steps=world.steps,
        renders=world.renders,
    )


def _belief(policy: Policy) -> Belief | None:
    said = policy.belief() if hasattr(policy, "belief") else None
    return None if said is None else Belief.model_validate(said)
