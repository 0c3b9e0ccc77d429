"""A planar monoped: a torso on one leg with hip, knee and ankle, which hops as fast as commanded.

Its policy was trained in 18 minutes of a busy core by

    integ-gym train --env examples.robots.monoped:Monoped --total-steps 700000 --n-envs 16 \
        --n-steps 128 --batch-size 512 --n-epochs 8 --learning-rate 0.0006 \
        --learning-rate-end 0.00002 --discount-time 2 --net-arch 64 64 --ent-coef 0 \
        --log-std-init=-2 --seed 2 --out examples/robots/monoped_policy
"""

from pathlib import Path

import numpy as np

from integ_gym import MjcfTestbed


class Monoped(MjcfTestbed):
    """Hops forward at a commanded speed; its joints are servos around their angles in a crouch."""

    control_period = 0.02
    keyframe = "crouch"
    together = True
    commands = {"v_x": (0.3, 1.0)}
    fall = "the torso tips by more than 45° or is lower than 0.5 m"
    achievement = "a mean speed within 0.2 m/s of the commanded one"

    def model(self):
        return Path(__file__).with_suffix(".xml")

    def start(self, robot, rng):
        robot.data.qpos[3:] += rng.uniform(-0.1, 0.1, 3)
        robot.data.qvel[:] = rng.uniform(-0.2, 0.2, 6)

    def height(self, robot):
        return robot.data.xpos[..., robot.model.body("torso").id, 2:]

    def observe(self, robot, memory, command):
        angles = robot.joint_angles - robot.home_angles
        body = [robot.sensor("velocity"), robot.sensor("gyro"), robot.gravity("imu")]
        joints = [angles, 0.1 * robot.joint_velocities, memory.last_action]
        return np.concatenate([*body, self.height(robot), *joints, command], axis=-1)

    def act(self, action, robot):
        return robot.key_ctrl + 0.5 * action

    def falls(self, robot):
        return (robot.gravity("imu")[..., 2] > -0.7) | (self.height(robot)[..., 0] < 0.5)

    def measure(self, robot):
        return robot.data.qvel[..., :1]

    def reward(self, robot, memory, command):
        error = (self.measure(robot) - command)[..., 0]
        return 0.5 + np.exp(-4.0 * (error * error))

    def achieves(self, robot, memory, command):
        return abs(robot.data.qpos[0] / robot.data.time - command[0]) < 0.2
