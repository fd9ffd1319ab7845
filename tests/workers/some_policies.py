"""Policies as a researcher might write them; a test names one as `module:Name`."""

# ruff: noqa: T201

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from hide_tasks.contract import Belief, Keyframe, Stop


class Stays:
    """Answers with the pose that it sees, and prints."""

    def reset(self, instruction, policy_seed):
        self.decisions = 0
        print(f"told: {instruction}, {policy_seed}")

    def act(self, observation):
        self.decisions += 1
        return Keyframe.at(observation.gripper_pose, opening=0.0)

    def belief(self):
        return Belief(stage_count=self.decisions)


class Lowers:
    """Goes down a centimetre with each decision of an episode."""

    def reset(self, instruction, policy_seed):
        self.decisions = 0

    def act(self, observation):
        self.decisions += 1
        x, y, z, *turn = observation.gripper_pose
        return Keyframe.at([x, y, z - 0.01 * self.decisions, *turn], opening=0.0)


class Answers:
    """Answers with a dictionary of arrays, as numpy users write it."""

    def reset(self, instruction, policy_seed):
        pass

    def act(self, observation):
        return {
            "kind": "keyframe",
            "position": observation.gripper_pose[:3],
            "quaternion": observation.gripper_pose[3:],
            "opening": np.float32(1.0),
            "ignore_collisions": np.bool_(True),
        }


class Stops(Stays):
    def act(self, observation):
        return Stop()


class Misbehaves:
    """Does what the instruction says."""

    def reset(self, instruction, policy_seed):
        self.what = instruction

    def act(self, observation):
        if self.what == "raise":
            raise RuntimeError("a line\nno such thing as a cup")
        if self.what == "exit":
            sys.exit(3)
        if self.what == "die":
            os._exit(3)
        if self.what == "abort":
            os.abort()
        if self.what == "sleep":
            time.sleep(60)
        if self.what == "object":
            return object()
        if self.what == "nan":
            return {"kind": "keyframe", "position": [float("nan")] * 3, "quaternion": [0, 0, 0, 1]}
        return Stop()

    def belief(self):
        return {"stage_count": "many"} if self.what == "believe" else None


class TellsAll:
    """Writes down everything that it can see of its episode."""

    def reset(self, instruction, policy_seed):
        self.told = {"instruction": instruction, "policy_seed": policy_seed}

    def act(self, observation):
        Path("told.json").write_text(
            json.dumps(
                {
                    **self.told,
                    "observation": sorted(vars(observation)),
                    "arguments": sys.argv,
                    "modules": sorted(sys.modules),
                    "pid": os.getpid(),
                }
            )
        )
        return Stop()


class NoAct:
    def reset(self, instruction, policy_seed):
        pass


class Raises(Stays):
    def act(self, observation):
        raise RuntimeError("no such thing as a cup")


class Hangs(Stays):
    def act(self, observation):
        time.sleep(60)


class Nonsense(Stays):
    def act(self, observation):
        return "left"


class DiesOnce(Stays):
    """Its process dies in the first episode that it ever plays; a file remembers that."""

    def act(self, observation):
        try:
            Path("died").touch(exist_ok=False)
        except FileExistsError:
            return Stop()
        os._exit(1)


class HangsWithAChild(Stays):
    def act(self, observation):
        subprocess.run([sys.executable, "-c", "import time; time.sleep(60)"])


class Slow(Stays):
    """Takes its time for two answers, then stops."""

    def act(self, observation):
        time.sleep(0.8)
        return super().act(observation) if self.decisions < 2 else Stop()
