"""Policies and their versions: registered, found by name or id."""

import difflib
from collections.abc import Sequence

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from seek_model import trained
from server import facts, smoke
from server.access import Principal
from server.models import Evaluation, Policy, PolicyVersion, new_id
from server.paging import after, page
from server.problems import Problem, invalid
from server.schemas.common import Page
from server.schemas.policies import PolicyFacts, PolicyVersionPublic
from workers.policies import BUILTIN
from workers.preflight import Check
from workers.protocol import BuiltInPolicy, PolicySpec, ReplayPolicy

ABOUT = {
    "expert": "Follows the task's script with the hidden state in hand.",
    "amnesiac": "Perfect sight and skill, and no memory.",
    "random": "Moves to random poses.",
    "noop": "Does nothing.",
}


def register_builtin(session: Session) -> None:
    """Makes sure that the built-in policies are there."""
    there = set(session.scalars(select(Policy.name)))
    for name in BUILTIN:
        if name not in there:
            spec = BuiltInPolicy(name=name)
            register(session, name, spec, description=ABOUT[name], reference=True)


def reserved(session: Session) -> tuple[str, ...]:
    """Names of the server's own policies, there or not.

    A trained policy's is not among them if somebody took it when there was no such policy yet.
    """
    wanted = select(Policy.name).where(
        Policy.name.in_(trained.POLICIES), Policy.owner_id.is_not(None)
    )
    taken = set(session.scalars(wanted))
    return (*BUILTIN, *(name for name in trained.POLICIES if name not in taken))


def require_own(session: Session, name: str, principal: Principal) -> None:
    """Does nothing if the principal may register a version of this name.

    Raises:
        Problem: 403, the policy is somebody else's; 422, it is the server's own.
    """
    if name in reserved(session):
        kind = "a built-in policy" if name in BUILTIN else "a trained policy that comes along"
        raise invalid("name", f"'{name}' is {kind}; choose another name, such as my-{name}")
    if policy := session.scalar(select(Policy).where(Policy.name == name)):
        principal.require_own(policy.owner_id, f"Policy '{name}'")


def register(
    session: Session,
    name: str,
    spec: PolicySpec,
    *,
    description: str = "",
    reference: bool = False,
    principal: Principal | None = None,
    checks: Sequence[Check] = (),
    known: PolicyFacts | None = None,
) -> PolicyVersion:
    """A policy's next version; whose first one it is owns the policy.

    Args:
        principal: who registers it; None for the server itself.
        checks: what was tried of it before.
        known: what is known of its memory, beyond what its kind tells.

    Raises:
        Problem: the name is the server's or somebody else's, or the replay's evaluation does not
            exist.
    """
    if principal is not None:
        require_own(session, name, principal)
    if isinstance(spec, ReplayPolicy) and session.get(Evaluation, spec.evaluation) is None:
        raise invalid("spec.evaluation", f"no evaluation '{spec.evaluation}'")
    policy = session.scalar(select(Policy).where(Policy.name == name))
    if policy is None:
        owner = principal.user if principal else None
        policy = Policy(id=new_id("po"), name=name, owner_id=owner)
        session.add(policy)
        session.flush()
    newest = func.coalesce(func.max(PolicyVersion.number), 0)
    count = session.scalar(select(newest).where(PolicyVersion.policy_id == policy.id)) or 0
    version = PolicyVersion(
        id=new_id("pv"),
        policy=policy,
        number=count + 1,
        description=description,
        spec=spec.model_dump(mode="json"),
        reference=reference,
        checks=[check.model_dump(mode="json") for check in checks],
        facts=known and known.model_dump(mode="json"),
    )
    session.add(version)
    session.flush()
    return version


def find(session: Session, text: str) -> PolicyVersion:
    """The version that an id, a name (the newest) or name@version names.

    Raises:
        Problem: there is none; it names the nearest.
    """
    if found := session.get(PolicyVersion, text):
        return found
    name, _, number = text.rpartition("@") if "@" in text else (text, "", "")
    wanted = select(PolicyVersion).join(Policy)
    if number.isdecimal() and len(number) < 10:
        exact = wanted.where(Policy.name == name, PolicyVersion.number == int(number))
        if found := session.scalar(exact):
            return found
    newest = wanted.where(Policy.name == text).order_by(PolicyVersion.number.desc()).limit(1)
    if found := session.scalar(newest):
        return found
    raise _unknown(session, text)


def _unknown(session: Session, text: str) -> Problem:
    names = list(session.scalars(select(Policy.name).order_by(Policy.name).limit(500)))
    near = difflib.get_close_matches(text, names, n=1, cutoff=0.5)
    hint = f"; did you mean {near[0]}?" if near else f"; there are {', '.join(names[:20])}"
    return invalid("policy", f"no policy '{text}'{hint}")


def versions(session: Session) -> list[PolicyVersionPublic]:
    """Every version of every policy: built-in ones first, then by name, the newest first."""
    found = (
        select(PolicyVersion)
        .join(Policy)
        .order_by(PolicyVersion.reference.desc(), Policy.name, PolicyVersion.number.desc())
    )
    return public_all(session, session.scalars(found).all())


def listed(
    session: Session, *, limit: int = 50, cursor: str | None = None
) -> Page[PolicyVersionPublic]:
    """Every version of every policy, the one that was registered last first.

    Raises:
        Problem: 422, the cursor is not ours.
    """
    wanted = select(PolicyVersion).order_by(PolicyVersion.id.desc()).limit(limit + 1)
    if place := after(cursor, [str]):
        wanted = wanted.where(PolicyVersion.id < place[0])
    rows = session.scalars(wanted).all()
    shown = {one.id: one for one in public_all(session, rows[:limit])}
    return page(rows, limit, lambda one: [one.id], lambda one: shown[one.id])


def public(session: Session, version: PolicyVersion) -> PolicyVersionPublic:
    """A version as the API gives it out."""
    return public_all(session, [version])[0]


def public_all(session: Session, versions: Sequence[PolicyVersion]) -> list[PolicyVersionPublic]:
    """Versions as the API gives them out."""
    tried = smoke.of(session, versions)
    return [_public(one, tried.get(one.id)) for one in versions]


def _public(version: PolicyVersion, tried: str | None) -> PolicyVersionPublic:
    return PolicyVersionPublic.model_validate(
        {
            "id": version.id,
            "policy": version.policy.name,
            "version": version.number,
            "description": version.description,
            "spec": version.spec,
            "reference": version.reference,
            "created": version.created,
            "owner": version.policy.owner and version.policy.owner.name,
            "checks": version.checks or [],
            "facts": facts.of_version(version),
            "smoke": tried,
        }
    )
