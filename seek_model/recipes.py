"""What `hide train` is told to do: the name of a preset, or a TOML file that changes one.

    preset = "seek-small"
    [model.memory]
    window = 4
    [train]
    tasks = ["search_drawer"]

A key that is left out keeps the preset's value. `memory = "none"` takes the memory away. Naming
another `kind` of backbone starts from that kind's defaults.
"""

import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from seek_model.config import Config, Phase
from seek_model.presets import NAMES, preset

SECTIONS = ("preset", "name", "model", "train")
KINDS = ("conv_film", "patch_transformer", "sam2")  # of backbones; pydantic names them in places


class BadRecipe(ValueError):
    """The recipe cannot be followed; the message names the key and what is allowed."""


def read(recipe: str) -> Config:
    """The configuration of a preset's name, or of a TOML file's path.

    Raises:
        BadRecipe: there is no such preset or file, or the first key that is wrong.
    """
    if not recipe.endswith(".toml"):
        return _preset(recipe, "")
    path = Path(recipe)
    try:
        document = tomllib.loads(path.read_text())
    except OSError as error:
        raise BadRecipe(f"{path}: {error.strerror}") from None
    except ValueError as error:
        raise BadRecipe(f"{path} is no TOML: {error}") from None
    return _followed(document, path)


def _followed(document: dict[str, Any], path: Path) -> Config:
    for key in document:
        if key not in SECTIONS:
            raise BadRecipe(f"{path}: no key '{key}'.{_near(key, SECTIONS)}")
    if "preset" not in document:
        raise BadRecipe(f"{path}: preset is missing. Presets: {', '.join(NAMES)}")
    changes = {key: value for key, value in document.items() if key != "preset"}
    base = _preset(document["preset"], f"{path}: ").model_dump()
    try:
        return Config.model_validate(_merged(base, {"name": path.stem} | changes))
    except ValidationError as error:
        raise BadRecipe(f"{path}: {_first(error)}") from None


def _preset(name: Any, where: str) -> Config:
    try:
        return preset(str(name))
    except ValueError as error:
        raise BadRecipe(f"{where}{error} Or give a file that ends in .toml.") from None


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """The base with the changes in it, table by table."""
    merged = dict(base)
    for key, value in changes.items():
        if key == "memory" and value == "none":
            merged[key] = None
        elif isinstance(value, Mapping):
            merged[key] = _merged(_started_from(merged.get(key), value), value)
        else:
            merged[key] = value
    return merged


def _started_from(base: Any, changes: Mapping[str, Any]) -> Mapping[str, Any]:
    """The base's table, unless it is of another kind."""
    if not isinstance(base, Mapping) or changes.get("kind", base.get("kind")) != base.get("kind"):
        return {}
    return base


def _first(error: ValidationError) -> str:
    """The first fault in one line; an unknown key with those that are known."""
    fault = error.errors(include_url=False)[0]
    place = [str(part) for part in fault["loc"]]
    key = ".".join(part for part in place if part not in KINDS)
    if fault["type"] == "extra_forbidden":
        return f"no key '{key}'.{_near(place[-1], _known(place[:-1]))}"
    message = fault["msg"].removeprefix("Value error, ")
    if isinstance(fault["input"], dict):  # of several keys that do not fit together
        return f"{key}: {message}"
    return f"{key} = {fault['input']!r:.60}: {message}"


def _known(place: list[str]) -> tuple[str, ...]:
    """The keys of the table at this place."""
    schema = Config.model_json_schema()
    table: dict[str, Any] = schema
    for key in place:
        table = _resolved(table.get("properties", {}).get(key) or _variant(table, key), schema)
    return tuple(table.get("properties", ()))


def _variant(table: dict[str, Any], kind: str) -> dict[str, Any]:
    """Of a table that comes in kinds, the one of this kind."""
    reference = table.get("discriminator", {}).get("mapping", {}).get(kind)
    return {"$ref": reference} if reference else {}


def _resolved(table: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    for choice in table.get("anyOf", ()):  # a table or null
        table = choice if "$ref" in choice else table
    if "$ref" in table:
        name = table["$ref"].rsplit("/", 1)[-1]
        return dict(schema["$defs"][name])
    return table


def _near(key: str, known: tuple[str, ...]) -> str:
    near = get_close_matches(key, known, n=1, cutoff=0.7)
    return (f" Did you mean {near[0]}?" if near else "") + f" Allowed: {', '.join(known)}"


def scaled(config: Config, factor: float) -> Config:
    """The same training with `factor` times the steps, horizon and warm-up of both phases."""
    train = config.train
    phases = {"first": _scaled(train.first, factor), "second": _scaled(train.second, factor)}
    return config.model_copy(update={"train": train.model_copy(update=phases)})


def _scaled(phase: Phase, factor: float) -> Phase:
    return phase.model_copy(
        update={
            "steps": round(phase.steps * factor),
            "horizon": max(round(phase.horizon * factor), 1),
            "warmup": round(phase.warmup * factor),
        }
    )
