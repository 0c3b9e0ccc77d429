"""Hoppers, each with one fault before any integration, and a testbed of two of them."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
from gymnasium.envs.mujoco.hopper_v5 import HopperEnv


class SwappedJoints(HopperEnv):
    """Observes the leg's angle where the thigh's is, and the thigh's where the leg's is."""

    def _get_obs(self):
        shown = super()._get_obs()
        shown[[2, 3]] = shown[[3, 2]]
        return shown


class TorsoFrame(HopperEnv):
    """Observes the torso's velocity in the torso's frame."""

    def _get_obs(self):
        shown, angle = super()._get_obs(), self.data.qpos[2]
        forward, up = self.data.qvel[:2]
        turned = np.cos(angle) * forward - np.sin(angle) * up
        shown[5:7] = turned, np.sin(angle) * forward + np.cos(angle) * up
        return shown


class SwappedActuators(HopperEnv):
    """Gives the thigh's command to the leg, and the leg's to the thigh."""

    def step(self, action):
        return super().step(np.asarray(action)[[1, 0, 2]])


class MissingClip(HopperEnv):
    """Its actuators take commands beyond their range."""

    def __init__(self, **arguments):
        super().__init__(**arguments)
        self.model.actuator_ctrllimited[:] = 0


class OtherGear(HopperEnv):
    """The leg's actuator has a tenth more gear."""

    def __init__(self, **arguments):
        super().__init__(**arguments)
        self.model.actuator_gear[1, 0] *= 1.1


class OtherGravity(HopperEnv):
    """Gravity is 9.80665 m/s² in place of 9.81."""

    def __init__(self, **arguments):
        super().__init__(**arguments)
        self.model.opt.gravity[2] = -9.80665


FAULTS = {
    SwappedJoints: ("observation", {"thigh_joint", "leg_joint"}),
    TorsoFrame: ("observation", {"rootx_dot", "rootz_dot"}),
    SwappedActuators: ("command", {"thigh_joint", "leg_joint"}),
    MissingClip: ("command", {"thigh_joint", "leg_joint", "foot_joint"}),
    OtherGear: ("force", {"leg_joint"}),
    OtherGravity: ("acceleration", {"rootz"}),
}
"""Boundary at which each shows, and components that differ there."""


def register(kind: type[HopperEnv]) -> str:
    """The id of a hopper, registered once."""
    env_id = f"{kind.__name__}-v0"
    if env_id not in gym.registry:
        gym.register(env_id, kind, max_episode_steps=1000)
    return env_id
