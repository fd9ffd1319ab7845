"""openpi's own client, run by the interpreter of an environment that has it: `… URL KEY`.

Prints one JSON document of what the server said. It imports nothing of ours.
"""

# ruff: noqa: T201
# mypy: ignore-errors

import json
import sys

import numpy as np
from openpi_client.websocket_client_policy import WebsocketClientPolicy

url, key = sys.argv[1:]
policy = WebsocketClientPolicy(url, api_key=key or None)
pose = np.array([0.2, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0])
observation = {
    "gripper_pose": pose,
    "gripper_opening": np.ones(1),
    "joint_positions": np.zeros(7),
    "instruction": "wait",
}
for camera in ("front", "left_shoulder", "right_shoulder", "wrist"):
    observation |= {
        f"{camera}/rgb": np.zeros((128, 128, 3), np.uint8),
        f"{camera}/depth": np.ones((128, 128), np.float32),
        f"{camera}/intrinsics": np.eye(3),
        f"{camera}/camera_to_world": np.eye(4),
    }
replies = [policy.infer(observation) for _ in range(2)]
policy.reset()
try:
    policy.infer({"instruction": "wait"})
    error = ""
except RuntimeError as raised:
    error = str(raised)
metadata = policy.get_server_metadata()
print(json.dumps({"metadata": metadata, "replies": replies, "error": error}))
