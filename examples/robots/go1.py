"""Unitree's Go1 as MuJoCo Playground trains it.

``integ-gym evaluate DIR/policy.onnx --env examples.robots.go1:Go1 --env-arg folder=DIR``
"""

from pathlib import Path

import numpy as np

from integ_gym import MjcfTestbed


class Go1(MjcfTestbed):
    """Walks as commanded; every joint is a servo around its angle in the keyframe."""

    control_period = 0.02
    keyframe = "home"
    together = True
    commands = {"v_x": (0.0, 1.5), "v_y": (-0.8, 0.8), "yaw_rate": (-1.2, 1.2)}
    fall = "the trunk tips by more than 60°"
    largest_error = 0.4  # of m/s, m/s and rad/s

    def model(self, folder):
        return Path(folder) / "scene_mjx_feetonly_flat_terrain.xml"

    def start(self, robot, rng):
        yaw = rng.uniform(-np.pi, np.pi)
        robot.data.qpos[3:7] = np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)
        robot.data.qvel[:6] = rng.uniform(-0.5, 0.5, 6)

    def observe(self, robot, memory, command):
        velocity, spin = robot.sensor("local_linvel"), robot.sensor("gyro")
        angles = robot.joint_angles - robot.home_angles
        joints = [angles, robot.joint_velocities, memory.last_action]
        body = [velocity, spin, robot.gravity("imu")]
        return np.concatenate([*body, *joints, command], axis=-1)

    def act(self, action, robot):
        return robot.key_ctrl + 0.5 * action

    def falls(self, robot):
        return robot.gravity("imu")[..., 2] > -0.5

    def measure(self, robot):
        velocity, spin = robot.sensor("local_linvel"), robot.sensor("gyro")
        return np.concatenate([velocity[..., :2], spin[..., 2:]], axis=-1)

    def reward(self, robot, memory, command):
        error = self.measure(robot) - command
        return np.exp(-4.0 * np.vecdot(error, error))
