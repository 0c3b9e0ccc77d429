"""Hoppers, each with one fault before any integration, and a testbed of two of them."""

from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import numpy as np
from gymnasium.envs.mujoco.hopper_v5 import HopperEnv

from integ_gym.envs.foreign import SequentialVectorEnv
from integ_gym.envs.settings import Discretization
from integ_gym.envs.testbeds.gym_testbed import Applied, SequentialTestbed, Success, class_path
from integ_gym.envs.testbeds.making import find_testbed


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


class TwoHoppers(SequentialTestbed):
    """Gymnasium's Hopper on the engine `mujoco`, and one with a fault on `gymnasium`."""

    home = Discretization("Euler", 0.002, 0.008, "gymnasium")
    success = Success("return of at least 1000", "success_return")

    def __init__(self, fault="OtherGear", **arguments):
        super().__init__({"fault": fault, **arguments})

    def integrators(self, engine):
        return ("Euler",)

    def make(self, discretization, lanes, autoreset_mode="NextStep", **arguments):
        engine = discretization.engine
        given = {**self.arguments, **arguments}
        faulty = globals()[given.pop("fault")]
        inner = find_testbed("Hopper-v5" if engine == "mujoco" else register(faulty), given)

        def make():
            env = inner.lane(discretization, given)
            settings = replace(env.setup.settings, engine=engine)
            env.setup = replace(
                env.setup, settings=settings, fingerprinted=None, testbed=class_path(type(self))
            )
            return env

        return SequentialVectorEnv(make, lanes, autoreset_mode)

    def applied(self, environments):
        task = environments.unwrapped.envs[0]
        integrator, step, count = task.applied
        engine = task.setup.settings.engine
        return Applied(Discretization(integrator, step, step * count, engine), count)


def stand(observation):
    """A policy that lets the hopper fall."""
    return np.zeros(3)
