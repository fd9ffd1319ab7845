"""What to do about an error, and where to go from there."""

import difflib
from typing import NamedTuple

from fastapi import Request

from hide_tasks import ALL_TASKS
from server.access import Principal, Scope
from server.problems import Problem

PAGES = {
    "/": "Leaderboard",
    "/evaluations": "Evaluations",
    "/evaluations/new": "New evaluation",
    "/failures": "Failures",
    "/comparisons": "Compare",
    "/ablations": "Ablations",
    "/tasks": "Tasks",
    "/batches": "Batches",
    "/snapshots": "Snapshots",
    "/demo": "Demo",
    "/account": "Your account",
}
ALIKE = 0.5  # of difflib's ratio
NEAREST = 3
USUAL = ("/", "/evaluations", "/tasks")


class Advice(NamedTuple):
    """A sentence, and links with their words."""

    sentence: str
    links: dict[str, str]


def advice(request: Request, problem: Problem) -> Advice:
    """What whoever meets an error can do."""
    path = request.url.path
    if problem.status == 404:
        return Advice("The nearest pages:", nearest(path))
    if problem.status in (405, 422) and request.method == "GET":
        sentence = "Correct the address, or begin without it:"
        return Advice(sentence, {path: f"{path}, with nothing chosen"} | _usual())
    return Advice(_sentence(request, problem), _usual())


def _sentence(request: Request, problem: Problem) -> str:
    me: Principal | None = getattr(request.state, "principal", None)
    if problem.status == 403 and me is not None and not me.may(Scope.ADMIN):
        return (
            f"You are {me.name}, a {me.role}. An administrator may give you another role; a page "
            "that was open for long has to be loaded again."
        )
    if problem.status == 403:
        return "Load the page again and repeat what you did; it may have been open for too long."
    if problem.status == 409:
        return "It is not as it was when you saw it. Go back, load that page again, and look."
    if problem.status == 429:
        wait = problem.headers.get("Retry-After")
        return f"Try again in {wait} s." if wait else "Wait a little, then try again."
    if problem.status == 503:
        return (
            "The server cannot do this now. Try again in a minute; if it stays so, its log and "
            "/api/v1/health/ready say why."
        )
    if problem.status >= 500:
        return (
            "It is no fault of yours. Whoever runs this server finds the reason in its log; "
            "hide doctor looks for the usual ones."
        )
    return "Go back and correct it."


def nearest(path: str) -> dict[str, str]:
    """Pages with addresses like this one, and the one above it."""
    known = PAGES | {f"/tasks/{name}": f"Task {name}" for name in ALL_TASKS}
    parts = path.rstrip("/").split("/")
    above = ["/".join(parts[:end]) for end in range(len(parts) - 1, 1, -1)]
    alike = difflib.get_close_matches(path, known, n=NEAREST, cutoff=ALIKE)
    found = dict.fromkeys([*(one for one in above if one in known), *alike, *USUAL])
    return {one: known[one] for one in found}


def _usual() -> dict[str, str]:
    return {one: PAGES[one] for one in USUAL}
