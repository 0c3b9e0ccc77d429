"""Gymnasium's mountain car as testbeds: it pays a bonus at its goal, and a cost on the way."""

from __future__ import annotations

import math

import numpy as np
from gymnasium.envs.classic_control import Continuous_MountainCarEnv
from gymnasium.wrappers import TimeLimit

import integ_gym


class FineMountainCar(Continuous_MountainCarEnv):
    """Gymnasium's mountain car with a step of its own; at 1 it is the original."""

    def __init__(self, bonus=100.0, scaled=False, start=None):
        super().__init__()
        self.start = start
        self.dt, self.bonus, self.scaled = 1.0, bonus, scaled

    def reset(self, **given):
        seen, info = super().reset(**given)
        if self.start is not None:
            self.state = seen = np.array([self.start, 0.0], np.float32)
        return seen, info

    def step(self, action):
        position, velocity = (float(x) for x in self.state)
        force = min(max(float(action[0]), -1.0), 1.0)
        velocity += self.dt * (force * self.power - 0.0025 * math.cos(3 * position))
        velocity = min(max(velocity, -self.max_speed), self.max_speed)
        position = max(position + self.dt * velocity, self.min_position)
        if position == self.min_position and velocity < 0:
            velocity = 0.0
        at_goal = position >= self.goal_position
        cost = 0.1 * force**2 * (self.dt if self.scaled else 1.0)
        self.state = np.array([position, velocity], np.float32)
        return self.state, at_goal * self.bonus - cost, at_goal, False, {}


class MountainCar(integ_gym.GymTestbed):
    """By the recipe of docs/how-to/testbeds.md."""

    home = integ_gym.Discretization("symplectic_euler", 1.0, 1.0, "gymnasium")
    choices = ("symplectic_euler",)
    rewards = "rate"
    scaled = False
    start = None

    def build(self, discretization, **arguments):
        env = TimeLimit(FineMountainCar(scaled=self.scaled, start=self.start), 200)
        env.unwrapped.dt = discretization.dt
        return self.held(env, discretization, rewards=self.rewards)

    def read(self, env):
        return self.as_applied("symplectic_euler", env.unwrapped.dt, env)


class ScaledMountainCar(MountainCar):
    """Its cost is an amount."""

    rewards, scaled = "sum", True


class FixedMountainCar(MountainCar):
    """Every episode is the same."""

    start = -0.5


class SilentMountainCar(MountainCar):
    """It does not say what its rewards are."""

    rewards = None


class SilentScaledMountainCar(ScaledMountainCar):
    """Neither does it, and they are amounts."""

    rewards = None


def swing(observation):
    """Push the way it goes, which gets there."""
    return [1.0 if observation[1] >= 0.0 else -1.0]
