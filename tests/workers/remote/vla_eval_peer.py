"""A small model behind vla-eval's own server, run by an interpreter that has it: `… PORT`.

It imports nothing of ours.
"""

# mypy: ignore-errors

import sys

import numpy as np
from vla_eval.model_servers.predict import PredictModelServer
from vla_eval.model_servers.serve import serve
from vla_eval.specs import GRIPPER_CLOSE_POS, POSITION_DELTA, ROTATION_AA


class Counts(PredictModelServer):
    """Moves up by a centimetre more with every observation of an episode."""

    async def on_episode_start(self, config, ctx):
        await super().on_episode_start(config, ctx)
        self.fails = config["task"]["name"] == "fail"

    def predict(self, obs, ctx):
        if self.fails:
            raise RuntimeError("no cup")
        assert obs["images"]["agentview"].shape == (8, 8, 3), obs["images"]["agentview"].shape
        assert obs["state"].tolist() == [0.0] * 7 + [1.0], obs["state"]
        assert obs["task_description"] == "wait", obs["task_description"]
        row = np.zeros(7)
        row[2] = ctx.step / 100
        return {"actions": row}

    def get_action_spec(self):
        return {"position": POSITION_DELTA, "rotation": ROTATION_AA, "gripper": GRIPPER_CLOSE_POS}

    def get_observation_spec(self):
        return {}


serve(Counts(), host="127.0.0.1", port=int(sys.argv[1]))
