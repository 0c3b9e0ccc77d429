"""Unitree's G1 as MuJoCo Playground trains it.

``integ-gym evaluate DIR/policy.onnx --env examples.robots.g1:G1 --env-arg folder=DIR``
"""

from .humanoid import Humanoid


class G1(Humanoid):
    """29 joints; the inertial unit is in the pelvis."""

    keyframe = "knees_bent"
    largest_error = 1.0  # its pelvis sways
    velocimeter, gyro, unit = "local_linvel_pelvis", "gyro_pelvis", "imu_in_pelvis"
