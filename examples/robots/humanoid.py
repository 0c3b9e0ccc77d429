"""What the humanoids of MuJoCo Playground have in common: gait phases, and servos on all joints."""

from pathlib import Path

import numpy as np

from integ_gym import MjcfTestbed


class Humanoid(MjcfTestbed):
    """Walks as commanded, with a clock of two legs that its policy sees."""

    control_period = 0.02
    together = True
    commands = {"v_x": (-1.0, 1.0), "v_y": (-0.5, 0.5), "yaw_rate": (-1.0, 1.0)}
    fall = "the body with the inertial unit tips by more than 60°"
    largest_error = 0.7  # of m/s, m/s and rad/s
    velocimeter, gyro, unit = "local_linvel", "gyro", "imu"
    scale = 0.5
    unseen, still = 0, 0.0  # joints; the command below which the clock stands

    def model(self, folder):
        return Path(folder) / "scene_mjx_feetonly_flat_terrain.xml"

    def start(self, robot, rng):
        yaw, data = rng.uniform(-np.pi, np.pi), robot.data
        data.qpos[3:7] = np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)
        data.qpos[7:] *= rng.uniform(0.5, 1.5, len(data.qpos) - 7)
        data.qvel[:6] = rng.uniform(-0.5, 0.5, 6)

    def frequency(self, command):
        return 1.5

    def observe(self, robot, memory, command):
        angles, speeds = robot.joint_angles - robot.home_angles, robot.joint_velocities
        angles[..., : self.unseen] = speeds[..., : self.unseen] = 0.0
        turn = 2.0 * np.pi * self.frequency(command) * memory.time
        phases = np.stack([turn, turn + np.pi], axis=-1)
        phases[np.sqrt(np.vecdot(command, command)) < self.still] = np.pi
        body = [robot.sensor(self.velocimeter), robot.sensor(self.gyro), robot.gravity(self.unit)]
        joints = [angles, speeds, memory.last_action]
        return np.concatenate([*body, command, *joints, np.cos(phases), np.sin(phases)], axis=-1)

    def act(self, action, robot):
        return robot.key_ctrl + self.scale * action

    def falls(self, robot):
        return robot.gravity(self.unit)[..., 2] > -0.5

    def measure(self, robot):
        velocity, spin = robot.sensor(self.velocimeter), robot.sensor(self.gyro)
        return np.concatenate([velocity[..., :2], spin[..., 2:]], axis=-1)

    def reward(self, robot, memory, command):
        error = self.measure(robot) - command
        return np.exp(-4.0 * np.vecdot(error, error))
