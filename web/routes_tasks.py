"""The tasks: what each asks, what it hides, and what a score on it means."""

from fastapi import Request
from fastapi.responses import HTMLResponse

from hide_tasks.contract import Category
from server import tasks
from server.access import Router, Scope, needs
from web.templating import page

router = Router(include_in_schema=False)


@router.get("/tasks")
@needs(Scope.READ)
def list_tasks(request: Request) -> HTMLResponse:
    """All tasks by category."""
    found = tasks.catalogue()
    groups = [(kind, [task for task in found if task.category is kind]) for kind in Category]
    return page(request, "tasks.html", {"groups": [(kind, some) for kind, some in groups if some]})


@router.get("/tasks/{name}")
@needs(Scope.READ)
def show_task(request: Request, name: str) -> HTMLResponse:
    """One task."""
    return page(request, "task.html", {"task": tasks.task(name)})
