"""docker-compose.yml keeps to the compose specification, and says what our commands understand."""

import importlib.resources
import json
from pathlib import Path
from typing import Any

import jsonschema_rs
import pytest
import yaml

ROOT = Path(__file__).parents[1]
SCHEMA = "builtin_schemas/vendor/compose-spec.json"


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    """The file, with what its anchors stand for."""
    found: dict[str, Any] = yaml.safe_load((ROOT / "docker-compose.yml").read_text())
    return found


@pytest.fixture(scope="module")
def specification() -> jsonschema_rs.Validator:
    """The compose specification's schema, as check-jsonschema carries it."""
    package = pytest.importorskip("check_jsonschema", reason="pip install check-jsonschema")
    schema = json.loads((importlib.resources.files(package) / SCHEMA).read_text())
    return jsonschema_rs.validator_for(schema)


def test_it_keeps_to_the_specification(
    specification: jsonschema_rs.Validator, document: dict[str, Any]
) -> None:
    assert [one.message for one in specification.iter_errors(document)] == []

    document["services"]["worker"] |= {"comand": ["worker"]}
    assert not specification.is_valid(document)
    del document["services"]["worker"]["comand"]


def test_services_depend_on_services_and_use_volumes_that_are_there(
    document: dict[str, Any],
) -> None:
    services = document["services"]

    assert set(services) == {"database", "server", "scheduler", "worker"}
    for service in services.values():
        assert set(service.get("depends_on", {})) <= set(services)
        named = {volume.partition(":")[0] for volume in service.get("volumes", [])}
        assert named <= set(document["volumes"])


@pytest.mark.parametrize("service", ["server", "scheduler", "worker"])
def test_commands_and_settings_are_ours(document: dict[str, Any], service: str) -> None:
    from typer.main import get_command

    from server.cli import app
    from server.settings import Settings

    name, *arguments = document["services"][service]["command"]
    environment = document["services"][service]["environment"]
    settings = {"HIDE_SERVER_" + field.upper() for field in Settings.model_fields}

    command = get_command(app).commands[name]  # type: ignore[attr-defined]
    assert command.make_context(name, list(arguments)).params
    assert set(environment) <= settings | {"HIDE_TOKEN"}


def test_the_image_holds_what_the_package_needs() -> None:
    lines = (ROOT / "Dockerfile").read_text().splitlines()
    copied = {part for line in lines if line.startswith("COPY") for part in line.split()[1:]}

    for needed in copied - {"./"}:
        assert (ROOT / needed).exists(), needed
    packages = {path.parent.name for path in ROOT.glob("*/__init__.py")} - {"tests"}
    assert packages <= copied
