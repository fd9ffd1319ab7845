"""What an episode's verdicts have to be, by its own decisions."""

from collections.abc import Mapping, Sequence
from typing import Any

from hide_tasks.contract import Failure, MotionOutcome

POLICY_FAILURES = {Failure.POLICY_ERROR, Failure.POLICY_INVALID, Failure.POLICY_TIMEOUT}
SOME_FAILURE = "some failure"  # the task names it from a state that no decision shows


def policy_failure(failure: str | None) -> Failure | None:
    """Which of the policy failures it is, if it is one."""
    return next((one for one in POLICY_FAILURES if one == failure), None)


def judged(
    failure: str | None, checks: Mapping[str, bool], decisions: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """The verdicts that follow from decisions; `hide_tasks.episode` says how.

    Args:
        failure: as it is stored; whether the policy failed shows nowhere else.
        checks: at the start, for an episode without a decision.
        decisions: as documents.
    """
    success = bool(decisions) and bool(decisions[-1]["success"])
    if policy_failure(failure):
        return {"success": success, "exact": False, "failure": failure}
    found = _failure(success, checks, decisions)
    if found == SOME_FAILURE and failure is not None:
        found = failure
    return {"success": success, "exact": found is None, "failure": found}


def _failure(
    success: bool, checks: Mapping[str, bool], decisions: Sequence[Mapping[str, Any]]
) -> str | None:
    violations = [one for decision in decisions for one in decision["violations"]]
    if violations:
        return str(violations[0])
    if success and all((decisions[-1]["checks"] if decisions else checks).values()):
        return None
    if decisions and MotionOutcome(decisions[-1]["outcome"]).failed:
        return str(Failure.UNREACHABLE_POSE)
    return SOME_FAILURE
