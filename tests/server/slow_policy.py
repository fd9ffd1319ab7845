"""A policy that takes its time, as large models do."""

import time

from hide_tasks.contract import Keyframe, Stop


class Slow:
    """Stays where it is for eight decisions of 0.5 s each, then stops."""

    def reset(self, instruction, policy_seed):
        self.decisions = 0

    def act(self, observation):
        time.sleep(0.5)
        self.decisions += 1
        return Keyframe.at(observation.gripper_pose) if self.decisions < 8 else Stop()
