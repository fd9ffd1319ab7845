"""The tasks of the suites as the API and the pages show them, from what is committed."""

from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hide_tasks import SUITES, UnknownTask
from hide_tasks.certificates import committed
from server import tables
from server.problems import Problem
from server.schemas.tasks import AliasPublic, CertificatePublic, TaskPublic

PICTURES = "/static/tasks"


def catalogue(of: str) -> list[TaskPublic]:
    """Every task of a suite, by category, then by name."""
    order = ["RC", "HSR", "EPT"]
    found = [_task(name) for name in SUITES[of]]
    return sorted(found, key=lambda one: (order.index(one.category), one.name))


def task(name: str) -> TaskPublic:
    """The task with this name.

    Raises:
        Problem: 404, there is none; it names the nearest.
    """
    try:
        return _task(name)
    except UnknownTask as error:
        raise Problem(404, "not_found", str(error)) from None


@lru_cache(maxsize=64)
def _task(name: str) -> TaskPublic:
    [entry] = tables.catalogue([name])
    proof = entry.pop("certificate")
    certificate = CertificatePublic.model_validate(proof) if proof else None
    aliases = [
        _alias(name, number, alias)
        for number, alias in enumerate(committed(name).get("aliases", []), start=1)
    ]
    picture = _picture(f"{name}.webp")
    return TaskPublic.model_validate(
        entry | {"certificate": certificate, "aliases": aliases, "picture": picture}
    )


def certificate(name: str) -> CertificatePublic | None:
    """A task's certificate, if it has one."""
    return _task(name).certificate


def _alias(name: str, number: int, alias: dict[str, Any]) -> AliasPublic:
    pictures = [_picture(f"{name}-alias-{number}-{side}.webp") for side in "ab"]
    return AliasPublic(
        why=alias["why"],
        hidden=alias["hidden"],
        next=[one["stage"] for one in alias["next"]],
        pixels=alias["pixels"],
        pictures=[one for one in pictures if one],
    )


@lru_cache(maxsize=1)
def _drawn() -> frozenset[str]:
    """Names of the pictures that the pages have; the pages are found by name, not imported."""
    spec = find_spec("web")
    places = spec.submodule_search_locations if spec else None
    folder = Path(places[0]) / "static" / "tasks" if places else Path("nowhere")
    return frozenset(file.name for file in folder.glob("*.webp"))


def _picture(name: str) -> str | None:
    return f"{PICTURES}/{name}" if name in _drawn() else None
