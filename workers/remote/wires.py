"""The wires over which policies are served; each is spoken by the module of its name.

openpi    openpi's WebSocket, with our own dialect
vla_eval  the WebSocket of vla-evaluation-harness
act       OpenVLA's POST /act, JSON with numpy arrays
gr00t     GR00T's ZeroMQ
"""

from typing import Literal

Wire = Literal["openpi", "vla_eval", "act", "gr00t"]
Dialect = Literal["hide", "roboarena", "openpi", "vla_eval", "act", "gr00t"]

SCHEMES: dict[Wire, tuple[str, ...]] = {
    "openpi": ("ws", "wss"),
    "vla_eval": ("ws", "wss"),
    "act": ("http", "https"),
    "gr00t": ("tcp",),
}
BY_SCHEME: dict[str, Wire] = {  # what an address stands for if nothing else is said
    "ws": "openpi",
    "wss": "openpi",
    "http": "act",
    "https": "act",
    "tcp": "gr00t",
}
STATELESS: tuple[Dialect, ...] = ("openpi", "act")  # told of no episode, but for a new connection
