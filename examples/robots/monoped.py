"""A planar monoped: a torso on one leg with hip, knee and ankle, which hops as fast as commanded.

Its policy beside this file was trained by

    integ-gym train --env examples.robots.monoped:Monoped --total-steps 1000000 --seed 1 \
        --out examples/robots/monoped
"""

from pathlib import Path

import numpy as np

from integ_gym import MjcfTestbed


class Monoped(MjcfTestbed):
    """Hops forward at a commanded speed; its joints are servos around their angles in a crouch."""

    control_period = 0.02
    keyframe = "crouch"
    commands = {"v_x": (0.3, 1.0)}
    fall = "the torso tips by more than 45° or is lower than 0.5 m"
    achievement = "a mean speed within 0.2 m/s of the commanded one"

    def model(self):
        return Path(__file__).with_suffix(".xml")

    def start(self, robot, rng):
        robot.data.qpos[3:] += rng.uniform(-0.05, 0.05, 3)
        robot.data.qvel[:] = rng.uniform(-0.1, 0.1, 6)

    def observe(self, robot, memory, command):
        angles = robot.joint_angles - robot.home_angles
        height = robot.data.body("torso").xpos[2:]
        body = [robot.sensor("velocity"), robot.sensor("gyro"), robot.gravity("imu"), height]
        joints = [angles, 0.1 * robot.joint_velocities, memory.last_action]
        return np.concatenate([*body, *joints, command])

    def act(self, action, robot):
        return robot.key_ctrl + 0.5 * action

    def falls(self, robot):
        return robot.gravity("imu")[2] > -0.7 or robot.data.body("torso").xpos[2] < 0.5

    def reward(self, robot, memory, command):
        error = robot.data.qvel[0] - command[0]
        return 0.5 + np.exp(-4.0 * error**2)

    def achieves(self, robot, memory, command):
        return abs(robot.data.qpos[0] / robot.data.time - command[0]) < 0.2
