"""Keys of policy servers: the operator's own, each sent to one host and to no other.

HIDE_REMOTE_KEYS='{"host:port": "key"}' in the environment of whoever connects. A process that
plays a policy is not given the variable.
"""

import os
from collections.abc import MutableMapping

from pydantic import TypeAdapter, ValidationError

from workers.remote.egress import Peer
from workers.sandbox.launch import KEYS as VARIABLE

_KEYS: TypeAdapter[dict[str, str]] = TypeAdapter(dict[str, str])


class BadKeys(ValueError):
    """The variable is set to something else."""


def key_of(peer: Peer, environment: MutableMapping[str, str] = os.environ) -> str | None:
    """The key for a host, if there is one.

    Raises:
        BadKeys: the variable does not hold keys; its value is not told.
    """
    try:
        keys = _KEYS.validate_json(environment.get(VARIABLE, "{}"))
    except ValidationError:
        form = '{"host:port": "key"}'
        raise BadKeys(f"{VARIABLE} is no JSON object of keys by host, {form}.") from None
    return keys.get(peer.place)
