"""Facts of the robot that tasks may know: where it starts, how far its fingers reach."""

import numpy as np

from hide_tasks.poses import Array

FINGERTIP = 0.00825  # m that the shut fingers reach beyond the tip (PyBullet's collision meshes)
HOME_POSE: Array = np.array(
    [0.29109332, -0.01, 1.46330070, 0.99624824, 0.0, 0.08654162, 0.0]
)  # of the tip at kinematics.HOME
