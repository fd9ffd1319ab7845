"""Policies for what goes wrong around them, and some that are wrong themselves."""

# ruff: noqa: T201

import os
import signal
import time

from hide_tasks.contract import Keyframe, Stop

DECIDING = "decides"  # what Steady prints


class Steady:
    """Takes a moment for each of two decisions, which are always the same."""

    def __init__(self):
        time.sleep(0.3)  # so that there is a time in which it is loaded

    def reset(self, instruction, policy_seed):
        self.decisions = 0

    def act(self, observation):
        print(DECIDING, flush=True)
        time.sleep(0.4)
        self.decisions += 1
        return Keyframe.at(observation.gripper_pose) if self.decisions < 2 else Stop()


class Poison:
    """Native code that crashes at the first picture; what was tried of it before went well."""

    def reset(self, instruction, policy_seed): ...

    def act(self, observation):
        os.kill(os.getpid(), signal.SIGSEGV)
