"""Policies and their versions."""

from fastapi import APIRouter, Response

from server import policies
from server.deps import Reading, TheHub
from server.problems import Problem, invalid
from server.schemas import PolicyCreate, PolicyVersionPublic
from workers.policies import BadPolicy, Hosted, Surroundings
from workers.protocol import PythonPolicy

router = APIRouter(prefix="/policies", tags=["policies"])
CHECK_LIMIT = 60.0  # s for importing and constructing a class


@router.get("")
def list_policies(session: Reading) -> list[PolicyVersionPublic]:
    """Every version of every policy."""
    return policies.versions(session)


@router.post("", status_code=201)
def register_policy(wanted: PolicyCreate, hub: TheHub, response: Response) -> PolicyVersionPublic:
    """A new policy, or the next version of one. It never changes afterwards."""
    if isinstance(wanted.spec, PythonPolicy) and not hub.settings.allow_python:
        raise Problem(
            403,
            "python_not_allowed",
            "A class of this machine runs with the server's rights; it is taken only by a server "
            "that was started with --allow-python.",
        )
    if isinstance(wanted.spec, PythonPolicy):
        _require_loads(wanted.spec)
        known = wanted.spec.model_copy(update={"sha256": wanted.spec.file_hash()})
        wanted = wanted.model_copy(update={"spec": known})
    with hub.database.writing() as session:
        version = policies.public(policies.register(session, wanted))
    response.headers["Location"] = f"/api/v1/policies/{version.id}"
    return version


def _require_loads(spec: PythonPolicy) -> None:
    """Loads the class once, in a process of its own: better now than in every episode."""
    try:
        Hosted(spec.target, Surroundings(timeout=spec.timeout)).check(CHECK_LIMIT)
    except BadPolicy as error:
        raise invalid("spec.target", str(error)) from None


@router.get("/{policy}")
def get_policy(policy: str, session: Reading) -> PolicyVersionPublic:
    """One version, by id, name (the newest) or name@version."""
    try:
        return policies.public(policies.find(session, policy))
    except Problem as problem:
        raise Problem(404, "not_found", problem.detail) from None
