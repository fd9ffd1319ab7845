"""The OpenAPI document holds whatever is sent: every answer is as described, and none is a 500."""

from collections.abc import Iterator

import httpx
import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from schemathesis import Case, GenerationMode
from schemathesis.checks import CHECKS, load_all_checks

from tests.server import ledgers
from tests.server.clients import served

EXAMPLES = 8  # of each route
load_all_checks()
CONFORMANCE = CHECKS.get_by_names(
    [
        "not_a_server_error",
        "status_code_conformance",
        "content_type_conformance",
        "response_schema_conformance",
    ]
)
# A stream of events is no document, and tus has a media type of its own.
LEFT_OUT = "/events$|/uploads"
Server = tuple[str, dict[str, list[str]]]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """The address of a server, and names that its paths know."""
    with served(tmp_path_factory.mktemp("openapi")) as (hub, here):
        done = ledgers.evaluated(hub.database, hub.blobs, tasks=["search_drawer"], episodes=2)
        with hub.database.reading() as session:
            episodes = [one.id for one in ledgers.episodes_of(session, done)]
        said = here.post(f"/api/v1/episodes/{episodes[0]}/labels", json={"note": "odd"})
        batch = here.post("/api/v1/batches", json={"items": [{"policy": "noop"}]})
        yield (
            str(here.base_url),
            {
                "evaluation": [done],
                "episode": episodes,
                "policy": ["expert", "noop@1"],
                "task": ["search_drawer"],
                "token": ["01arz3ndektsv4rrffq69g5fav"],
                "user": ["owner"],
                "batch": [batch.json()["id"]],
                "label": [said.json()["id"]],
                "snapshot": ["1"],
                "webhook": ["wh_01ARZ3NDEKTSV4RRFFQ69G5FAV"],
                "delivery": ["msg_01ARZ3NDEKTSV4RRFFQ69G5FAV"],
            },
        )


@pytest.mark.parametrize("mode", [GenerationMode.POSITIVE, GenerationMode.NEGATIVE])
def test_every_answer_is_as_described(server: Server, mode: GenerationMode) -> None:
    address, names = server
    schema = schemathesis.openapi.from_url(f"{address}/api/v1/openapi.json")
    operations = [
        result.ok() for result in schema.exclude(path_regex=LEFT_OUT).get_all_operations()
    ]
    assert len(operations) > 20

    for operation in operations:
        if mode is GenerationMode.NEGATIVE and not (operation.body or operation.query):
            continue  # nothing to be wrong about but the path

        @settings(
            max_examples=EXAMPLES,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        @given(case=operation.as_strategy(generation_mode=mode), known=st.data())
        def conforms(case: Case, known: st.DataObject) -> None:
            for name in case.path_parameters or {}:
                if name in names and known.draw(st.booleans()):
                    case.path_parameters[name] = known.draw(st.sampled_from(names[name]))
            case.call_and_validate(checks=CONFORMANCE)

        conforms()


def test_the_document_says_which_token_an_operation_wants(server: Server) -> None:
    address, _ = server
    document = httpx.get(f"{address}/api/v1/openapi.json").json()

    assert document["components"]["securitySchemes"]["token"]["scheme"] == "bearer"
    paths = document["paths"]
    assert paths["/api/v1/evaluations"]["post"]["security"] == [{"token": ["submit"]}]
    assert paths["/api/v1/users"]["get"]["security"] == [{"token": ["admin"]}]
    assert paths["/api/v1/me"]["get"]["security"] == [{"token": []}]
    assert "security" not in paths["/api/v1/health/live"]["get"]
