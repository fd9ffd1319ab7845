"""Facts of the robot that tasks may know: where it starts, how far its fingers reach."""

import numpy as np

from hide_tasks.poses import Array

FINGERTIP = 0.00825  # m that the shut fingers reach beyond the tip (PyBullet's collision meshes)
HOME_POSE: Array = np.array(
    [
        0.29109332542381733,
        -0.01,
        1.4633006898583876,
        0.9962482370536716,
        -9.148560271454958e-07,
        0.08654160945237946,
        -7.947127037388894e-08,
    ]
)  # of the tip at kinematics.HOME; exact, so that the arm comes home to the joints it left
