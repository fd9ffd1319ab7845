"""The API's document in the repository is the present one, and what would break programs is found.

The changes are made to the real document, one at a time.
"""

import copy
import json
from collections.abc import Callable
from typing import Any

import pytest

from docs import make_openapi
from docs.openapi_changes import breaking

Document = dict[str, Any]
Change = Callable[[Document], object]
OLD: Document = json.loads(make_openapi.FILE.read_text())
EVALUATIONS = "/api/v1/evaluations"


@pytest.fixture(scope="module")
def present() -> Document:
    return make_openapi.present()


def test_nothing_that_programs_rely_on_is_gone(present: Document) -> None:
    assert breaking(OLD, present) == []


def test_the_document_in_the_repository_is_the_present_one(present: Document) -> None:
    text = make_openapi.FILE.read_text()

    assert text == make_openapi.written(present), "run .venv/bin/python -m docs.make_openapi"


def schema(document: Document, name: str) -> Document:
    found: Document = document["components"]["schemas"][name]
    return found


def field(document: Document, model: str, name: str) -> Document:
    found: Document = schema(document, model)["properties"][name]
    return found


def query(document: Document, name: str) -> Document:
    found = document["paths"][EVALUATIONS]["get"]["parameters"]
    return next(one for one in found if one["name"] == name)


def changed(change: Change) -> list[str]:
    """What breaks when the document is changed so."""
    new = copy.deepcopy(OLD)
    change(new)
    assert new != OLD, "nothing was changed"
    return breaking(OLD, new)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda d: d["paths"].pop("/api/v1/tasks"), "GET /api/v1/tasks: the route is gone"),
        (lambda d: d["paths"][EVALUATIONS].pop("post"), "POST /api/v1/evaluations: the route"),
        (lambda d: schema(d, "EvaluationPublic")["properties"].pop("verdicts"),
         "verdicts: the field is gone"),
        (lambda d: schema(d, "EvaluationPublic")["required"].remove("state"),
         "state: the field may now be missing"),
        (lambda d: schema(d, "EvaluationCreate")["properties"].pop("rules"),
         "rules: the field is gone"),
        (lambda d: schema(d, "EvaluationCreate")["required"].append("split"),
         "split: the field is now required"),
        (lambda d: schema(d, "EvaluationState")["enum"].remove("incomplete"), "incomplete is gone"),
        (lambda d: field(d, "EvaluationCreate", "split")["enum"].remove("val"), "val is gone"),
        (lambda d: field(d, "EvaluationCreate", "policy").update(maxLength=50),
         "maxLength was 100 and is 50"),
        (lambda d: field(d, "EvaluationCreate", "policy").update(pattern="^a"), "its pattern was"),
        (lambda d: field(d, "EvaluationPublic", "episodes").update(type="string"),
         "integer became string"),
        (lambda d: field(d, "EvaluationPublic", "created").update(
            anyOf=[{"type": "string"}, {"type": "null"}]), "created: it may now be null"),
        (lambda d: field(d, "EvaluationCreate", "tasks")["anyOf"].pop(),
         "tasks: null is no longer taken"),
        (lambda d: query(d, "policy").update(required=True), "policy is now required"),
        (lambda d: d["paths"][EVALUATIONS]["get"]["parameters"].remove(query(d, "state")),
         "the query parameter state is gone"),
        (lambda d: d["paths"][EVALUATIONS]["post"]["responses"].pop("202"),
         "it no longer answers 202"),
        (lambda d: d["paths"]["/api/v1/leaderboard/export"]["get"]["responses"]["200"][
            "content"].pop("text/csv"), "it no longer answers text/csv"),
    ],
)  # fmt: skip
def test_what_breaks_is_found(change: Change, told: str) -> None:
    assert told in "; ".join(changed(change))


def add_route(document: Document) -> None:
    document["paths"]["/api/v1/news"] = copy.deepcopy(document["paths"]["/api/v1/tasks"])


@pytest.mark.parametrize(
    "change",
    [
        add_route,
        lambda d: schema(d, "EvaluationPublic")["properties"].update(news={"type": "string"}),
        lambda d: schema(d, "EvaluationCreate")["properties"].update(news={"type": "string"}),
        lambda d: schema(d, "EvaluationState")["enum"].append("paused"),
        lambda d: field(d, "EvaluationCreate", "split")["enum"].append("hard"),
        lambda d: field(d, "EvaluationCreate", "policy").update(maxLength=200),
        lambda d: (
            schema(d, "EvaluationPublic")["required"].remove("state")
            or schema(d, "EvaluationPublic")["required"].append("state")
        ),
        lambda d: d["paths"][EVALUATIONS]["get"]["parameters"].append(
            {"name": "owner", "in": "query", "required": False, "schema": {"type": "string"}}
        ),
    ],
)
def test_what_is_added_breaks_nothing(change: Change) -> None:
    assert changed(change) == []


def test_what_breaks_is_not_written(tmp_path, monkeypatch, capsys, present: Document) -> None:
    file = tmp_path / "openapi.json"
    before = copy.deepcopy(present)
    before["paths"]["/api/v1/gone"] = before["paths"]["/api/v1/tasks"]
    file.write_text(make_openapi.written(before))
    monkeypatch.setattr(make_openapi, "FILE", file)
    monkeypatch.setattr(make_openapi, "present", lambda: present)

    refused = make_openapi.main([])
    kept = json.loads(file.read_text()) == before
    told = capsys.readouterr().err
    forced = make_openapi.main(["--break"])

    assert (refused, kept, forced) == (2, True, 0)
    assert "GET /api/v1/gone: the route is gone" in told
    assert json.loads(file.read_text()) == present
