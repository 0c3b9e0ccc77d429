"""Apptronik's Apollo as MuJoCo Playground trains it.

``integ-gym evaluate DIR/policy.onnx --env examples.robots.apollo:Apollo --env-arg folder=DIR``
"""

import numpy as np

from .humanoid import Humanoid


class Apollo(Humanoid):
    """32 joints; its gait is faster the more it is commanded."""

    keyframe = "knees_bent"
    still = 0.01
    commands = {"v_x": (-1.5, 1.5), "v_y": (-0.8, 0.8), "yaw_rate": (-1.5, 1.5)}

    def frequency(self, command):
        return 1.25 + 0.5 * np.minimum(np.sqrt(np.vecdot(command, command)), 1.5) / 1.5
