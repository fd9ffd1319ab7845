"""What is known of a policy's memory: what its checkpoint says, or what was declared.

A built-in policy is known by its name; a checkpoint by its configuration; anything else says of
itself what it likes, or nothing, and stands as "undeclared".
"""

from typing import Any

from seek_model.config import Config, Memory
from seek_model.presets import preset
from server.models import PolicyVersion
from server.schemas.common import Component
from server.schemas.policies import PolicyDeclared, PolicyFacts

UNDECLARED = "undeclared"
NONE = "none"
BUILT_IN = {
    "expert": PolicyFacts(source="built-in", memory="script", clock=False, privileged=True),
    "amnesiac": PolicyFacts(source="built-in", memory=NONE, clock=False, privileged=True),
    "random": PolicyFacts(source="built-in", memory=NONE, clock=False, privileged=False),
    "noop": PolicyFacts(source="built-in", memory=NONE, clock=False, privileged=False),
}


def of_version(version: PolicyVersion) -> PolicyFacts:
    """What is known of a policy version."""
    if version.facts is not None:
        return PolicyFacts.model_validate(version.facts)
    return _by_kind(version.spec)


def of_config(config: Config) -> PolicyFacts:
    """What a checkpoint's configuration says."""
    memory = config.model.memory
    parts = _components(memory)
    return PolicyFacts(
        source="checkpoint",
        memory="+".join(parts) or NONE,
        components=parts,
        window=memory.window if memory else 0,
        content=memory.content if memory else None,
        clock=config.model.clock,
        privileged=memory is not None and memory.anchor == "oracle",
        preset=config.name,
    )


def declared(said: PolicyDeclared) -> PolicyFacts:
    """What whoever registers a policy says of it."""
    return PolicyFacts(
        source="declared",
        memory=said.memory or UNDECLARED,
        clock=said.clock,
        privileged=said.privileged,
    )


def _components(memory: Memory | None) -> list[Component]:
    if memory is None:
        return []
    there: dict[Component, bool] = {
        "SCM": memory.stages > 0,
        "WCM": memory.window > 0,
        "PAM": memory.anchor != "none",
    }
    return [name for name, is_there in there.items() if is_there]


def _by_kind(spec: dict[str, Any]) -> PolicyFacts:
    """Of versions from before facts were kept, and of those that declare nothing."""
    if spec["kind"] == "builtin":
        return BUILT_IN[spec["name"]]
    if spec["kind"] == "checkpoint":
        return _of_preset(spec["model"])
    memory = "recording" if spec["kind"] == "replay" else UNDECLARED
    return PolicyFacts(source="unknown", memory=memory)


def _of_preset(name: str) -> PolicyFacts:
    try:
        return of_config(preset(name))
    except ValueError:  # a configuration of somebody's own
        return PolicyFacts(source="unknown", memory=UNDECLARED, preset=name)
