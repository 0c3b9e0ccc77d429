"""Baselines by name: random, zero and hand-made controllers."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from functools import cached_property
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from integ_gym.envs.actuators import ServoPlant
from integ_gym.envs.registries import TASKS
from integ_gym.envs.settings import Setup
from integ_gym.support.errors import InputError
from integ_gym.support.parameters import unknown_name
from integ_gym.support.registry import Registry

from .policy import ActionArray, FloatArray, Policy


class Baseline:
    """What all baselines have: a name, and a hash over the name and the design parameters."""

    policy_id: str

    def parameters(self) -> dict[str, Any]:
        """Everything that decides the actions, JSON-serialisable."""
        raise NotImplementedError

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 (hex) over class, name and design parameters, the same in every process."""
        described = {
            "format": "integ-gym baseline 1",
            "class": type(self).__name__,
            "name": self.policy_id,
            "parameters": self.parameters(),
        }
        return hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()


class RandomPolicy(Baseline):
    """Uniform over the action space, as a fixed random function of the observation.

    The action is a hash of the seed and of the observation's float32 bits, made uniform. So the
    policy has no memory: an episode that is played again, alone or in another batch, is the same
    episode, as with every other policy. Observations that differ in one bit give independent
    actions.

    Args:
        space: of actions: `Discrete`, or a `Box` of action_dim numbers with finite bounds.
        seed: chooses the function.

    Raises:
        ValueError: for another space.
    """

    policy_id = "random"
    any_batch = True

    def __init__(self, space: spaces.Space[Any], seed: int = 0) -> None:
        self.seed = seed
        self.count = int(space.n) if isinstance(space, spaces.Discrete) else None
        if self.count is None:
            self.low, self.high = bounds_of(space)

    def parameters(self) -> dict[str, Any]:
        """Seed and action space, its bounds as one number where one says them."""
        common = {"seed": self.seed, "actions": self.count}
        if self.count is not None:
            return common
        low, high = self.low.tolist(), self.high.tolist()
        limits = {"limit": high[0]} if low == [-high[0]] else {"low": low, "high": high}
        return {**common, **limits}

    def act(self, observations: NDArray[Any]) -> ActionArray:
        """Random actions.

        Args:
            observations: shape (n, obs_dim).

        Returns:
            float32 of shape (n, action_dim), or int64 of shape (n,) for a `Discrete` space.
        """
        if self.count is not None:
            uniform = hash_to_uniform(observations, self.seed, 1)[:, 0]
            return (uniform * self.count).astype(np.int64)
        uniform = hash_to_uniform(observations, self.seed, len(self.low))
        middle, reach = 0.5 * (self.high + self.low), 0.5 * (self.high - self.low)
        return (middle + (2.0 * uniform - 1.0) * reach).astype(np.float32)


def bounds_of(space: spaces.Space[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower and upper bounds of a `Box`, each the shortest decimal number that its float32 means.

    Raises:
        ValueError: for a space that is no `Box` of numbers with finite bounds.
    """
    if not (isinstance(space, spaces.Box) and space.shape and space.is_bounded()):
        raise InputError(
            f"random and zero are for a Discrete set or a bounded Box of actions, got {space}"
        )
    low, high = (
        np.array([float(str(x)) for x in side]) for side in (space.low.ravel(), space.high.ravel())
    )
    return low, high


def hash_to_uniform(observations: NDArray[Any], seed: int, count: int) -> NDArray[np.float64]:
    """Numbers in [0, 1) that a hash makes of the seed and of the observations' float32 bits.

    Args:
        observations: shape (n, obs_dim).
        seed: chooses the function.
        count: numbers per observation.

    Returns:
        Shape (n, count).
    """
    values = np.asarray(observations, dtype=np.float32) + np.float32(0.0)  # -0.0 is 0.0
    bits = np.full(len(values), seed, dtype=np.uint64)
    for column in values.view(np.uint32).T:
        bits = _splitmix64(bits ^ column.astype(np.uint64))
    drawn = [bits]
    for _ in range(count - 1):
        drawn.append(_splitmix64(drawn[-1]))
    return (np.stack(drawn, axis=1) >> np.uint64(11)).astype(np.float64) * 2.0**-53


def _splitmix64(bits: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """One step of SplitMix64: Steele, Lea and Flood (2014), *Fast splittable pseudorandom number
    generators*."""
    bits = bits + np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))


class ZeroPolicy(Baseline):
    """No control at all: zero, or where the bounds leave it out, the bound that is nearest to it.

    A `Discrete` action set has no zero (the cart-pole's two actions push left and right), so there
    the action is NaN, on which the environment's fallback acts. It gives 0 N from the first step:
    with ``fallback="zero"`` because it says so, and with ``fallback="hold"`` because before any
    command there is nothing but 0 N to hold. Every step is counted as fallback.

    Args:
        space: of actions: `Discrete`, or a `Box` of action_dim numbers with finite bounds.

    Raises:
        ValueError: for another space.
    """

    policy_id = "zero"
    any_batch = True

    def __init__(self, space: spaces.Space[Any]) -> None:
        self.discrete = isinstance(space, spaces.Discrete)
        self.action = np.float32(np.nan)
        if not self.discrete:
            low, high = bounds_of(space)
            self.action = np.clip(0.0, low, high).astype(np.float32)

    def parameters(self) -> dict[str, Any]:
        """Kind of the action space, and the action where it is not zero."""
        other = {} if self.discrete or not self.action.any() else {"action": self.action.tolist()}
        return {"discrete": self.discrete, **other}

    def act(self, observations: NDArray[Any]) -> FloatArray:
        """Zeros of shape (n, action_dim), or NaN of shape (n,) for a `Discrete` space; float32."""
        return np.full((len(observations), *self.action.shape), self.action)


BASELINES = ("random", "zero", "handmade")
"""Names that `make_baseline` takes, for every environment."""

HANDMADE = Registry(
    "hand-made controller",
    "act",
    {
        "acrobot_reach": "integ_gym.train.acrobot:AcrobotPump",
        "acrobot_swing_up": "integ_gym.train.acrobot:AcrobotEnergyShaping",
        "cart_pole_balance": "integ_gym.train.controllers:BangBangRegulator",
        "cart_pole_swing_up": "integ_gym.train.controllers:CartPoleEnergyShaping",
        "elastic_pendulum_quiet": "integ_gym.train.controllers:SwingRegulator",
        "hopper_run": "integ_gym.train.hopper:HoppingInThreeParts",
        "pendulum_swing_up": "integ_gym.train.controllers:EnergyShaping",
        "quadrotor_hover": "integ_gym.train.quadrotor:HoverRegulator",
        "reacher_follow": "integ_gym.train.reacher:InverseKinematics",
    },
)
"""Controllers by the name of the task that they are for."""


def make_baseline(name: str, setup: Any, *, seed: int = 0, controller: str | None = None) -> Policy:
    """A baseline controller for an environment.

    Args:
        name: one of `BASELINES`.
        setup: of the environment, such as ``env.unwrapped.setup``: random and zero are made from
            its action space alone. The hand-made controller is designed for its plant, limits and
            control period, never for its integrator; latency, noise and fallback are not
            compensated.
        seed: of `random`.
        controller: of `handmade`, a registered name or ``"module:Class"``, made from the setup;
            None: the one that is for the setup's task.

    Raises:
        ValueError: for an unknown name, a plant whose parameters differ between lanes, or, of
            `handmade`, an environment that has none or whose gravity is 0.
    """
    if name not in BASELINES:
        raise InputError(unknown_name("baseline", name, BASELINES))
    varied = [key for key, value in setup.arguments().items() if isinstance(value, np.ndarray)]
    if varied:
        raise InputError(
            f"a baseline is made for one plant, and {', '.join(varied)} has one value per lane; "
            "make one baseline per value"
        )
    if name == "random":
        return RandomPolicy(setup.action_space, seed)
    if name == "zero":
        return ZeroPolicy(setup.action_space)
    return _handmade(setup, controller)


def possible_baselines(setup: Any, controller: str | None = None) -> tuple[str, ...]:
    """Names of the baselines that can be made for an environment; see `make_baseline`."""
    possible = []
    for name in BASELINES:
        with suppress(ValueError):
            make_baseline(name, setup, controller=controller)
            possible.append(name)
    return tuple(possible)


def has_handmade(setup: Setup) -> bool:
    """Whether there is a hand-made controller for the environment's task and its actuators."""
    return _takes_targets(setup.task) == isinstance(setup.plant, ServoPlant) and any(
        isinstance(setup.task, TASKS.load(name)) for name in HANDMADE.parts
    )


def _takes_targets(task: Any) -> bool:
    """Whether the hand-made controller of a task gives targets of servos, not efforts."""
    return getattr(task, "takes_targets", False)


def _handmade(setup: Any, controller: str | None) -> Policy:
    """The hand-made controller of that name, or of the environment's task."""
    tasks = {name: TASKS.load(name) for name in HANDMADE.parts}
    fitting = (name for name, task in tasks.items() if isinstance(setup.task, task))
    chosen = controller or next(fitting, None)
    if chosen is None:
        raise InputError(
            f"there is no hand-made controller for the task {type(setup.task).__name__}, only for "
            f"{', '.join(task.__name__ for task in tasks.values())}; leave `handmade` out"
        )
    targets, servos = _takes_targets(setup.task), isinstance(setup.plant, ServoPlant)
    if controller is None and servos != targets:
        gives, takes = ("targets", "effort") if targets else ("efforts", "position")
        raise InputError(
            f"the hand-made controller gives {gives}, and `actuator`={takes!r} takes none; leave "
            "`handmade` out, or give a `controller` of your own"
        )
    if setup.arguments().get("gravity") == 0.0 and not servos:
        raise InputError("without gravity there is nothing to balance; leave `handmade` out")
    policy: Policy = HANDMADE.load(chosen)(setup)
    return policy
