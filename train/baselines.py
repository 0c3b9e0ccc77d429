"""Controllers that nobody trained, for the same seat as a trained policy.

`random` and `zero` say what no skill reaches; `handmade` says what the physics allows. Where a
trained policy fails and `handmade` succeeds, learning has failed, not the actuator.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import asdict
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.array_ops import ARRAY
from integ_gym.envs.engines.native import NativeEngine
from integ_gym.envs.parameters import unknown_name
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.elastic_pendulum import ElasticPendulum
from integ_gym.envs.plants.interface import join_state, split_state
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.settings import Setup
from integ_gym.envs.system import PlantSystem
from integ_gym.envs.tasks.cart_pole_balance import CartPoleBalance
from integ_gym.envs.tasks.cart_pole_swing_up import CartPoleSwingUp
from integ_gym.envs.tasks.elastic_pendulum_quiet import NEAR_PLUMB, ElasticPendulumQuiet
from integ_gym.envs.tasks.pendulum_swing_up import PendulumSwingUp, wrapped
from integ_gym.train.lqr import held, linearized, lqr, lqr_gain
from integ_gym.train.policy import ActionArray, FloatArray, Policy

BASELINES = ("random", "zero", "handmade")
"""Names that `make_baseline` takes, for every environment."""

_CATCH_TIME = 4.0
"""How long the regulator may take, in simulation, to bring a state near upright, s."""
_CATCH_ANGLE = 0.1
"""How near upright it must then be, rad."""
_DIRECTIONS = 64
"""How many directions of the state space the cart-pole's regulator is tried in."""
_STEP_RATE = 0.1
"""Largest integration step of that simulation times the pendulum's rate √(m g c / I)."""


def make_baseline(name: str, setup: Setup, *, seed: int = 0) -> Policy:
    """A baseline controller for an environment.

    Args:
        name: one of `BASELINES`.
        setup: ``env.unwrapped.setup``. The controller is designed for its plant, limits and control
            period, never for its integrator; latency, noise and fallback are not compensated.
        seed: of `random`.

    Raises:
        ValueError: for an unknown name, a plant whose parameters differ between lanes, or, of
            `handmade`, an environment that has none or that has no gravity.
    """
    if name not in BASELINES:
        raise ValueError(unknown_name("baseline", name, BASELINES))
    varied = [key for key, value in setup.arguments().items() if isinstance(value, np.ndarray)]
    if varied:
        raise ValueError(
            f"a baseline is made for one plant, and {', '.join(varied)} has one value per lane; "
            "make one baseline per value"
        )
    if name == "random":
        return RandomPolicy(setup, seed)
    if name == "zero":
        return ZeroPolicy(setup)
    return _handmade(setup)


def has_handmade(setup: Setup) -> bool:
    """Whether there is a hand-made controller for the environment's task."""
    return isinstance(setup.task, tuple(_HANDMADE))


def _handmade(setup: Setup) -> Policy:
    """The hand-made controller of the environment's task."""
    if not setup.arguments()["gravity"]:
        raise ValueError("without gravity there is nothing to balance; leave `handmade` out")
    for task, maker in _HANDMADE.items():
        if isinstance(setup.task, task):
            return maker(setup)
    raise ValueError(
        f"there is no hand-made controller for the task {type(setup.task).__name__}, only for "
        f"{', '.join(task.__name__ for task in _HANDMADE)}; leave `handmade` out"
    )


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
        setup: of the environment.
        seed: chooses the function.
    """

    policy_id = "random"

    def __init__(self, setup: Setup, seed: int = 0) -> None:
        self.seed = seed
        self.count = setup.task.discrete
        self.limit = float(setup.task.control_limit)

    def parameters(self) -> dict[str, Any]:
        """Seed and action space."""
        return {"seed": self.seed, "actions": self.count, "limit": self.limit}

    def act(self, observations: NDArray[Any]) -> ActionArray:
        """Random actions.

        Args:
            observations: shape (n, obs_dim).

        Returns:
            float32 of shape (n, 1), N or N m, or int64 of shape (n,) for a `Discrete` space.
        """
        uniform = hashed_uniform(observations, self.seed, 1)[:, 0]
        if self.count is not None:
            return (uniform * self.count).astype(np.int64)
        return ((2.0 * uniform - 1.0) * self.limit).astype(np.float32)[:, None]


def hashed_uniform(observations: NDArray[Any], seed: int, count: int) -> NDArray[np.float64]:
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
        bits = _scrambled(bits ^ column.astype(np.uint64))
    drawn = [bits]
    for _ in range(count - 1):
        drawn.append(_scrambled(drawn[-1]))
    return (np.stack(drawn, axis=1) >> np.uint64(11)).astype(np.float64) * 2.0**-53


def _scrambled(bits: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """One step of SplitMix64: Steele, Lea and Flood (2014), *Fast splittable pseudorandom number
    generators*."""
    bits = bits + np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))


class ZeroPolicy(Baseline):
    """No control at all: 0 N m, or 0 N.

    A `Discrete` action set has no zero (the cart-pole's two actions push left and right), so there
    the action is NaN, on which the environment's fallback acts. It gives 0 N from the first step:
    with ``fallback="zero"`` because it says so, and with ``fallback="hold"`` because before any
    command there is nothing but 0 N to hold. Every step is counted as fallback.

    Args:
        setup: of the environment.
    """

    policy_id = "zero"

    def __init__(self, setup: Setup) -> None:
        self.discrete = setup.task.discrete is not None

    def parameters(self) -> dict[str, Any]:
        """Kind of the action space."""
        return {"discrete": self.discrete}

    def act(self, observations: NDArray[Any]) -> FloatArray:
        """Zeros of shape (n, 1), or NaN of shape (n,) for a `Discrete` space; float32."""
        n = len(observations)
        if self.discrete:
            return np.full(n, np.nan, dtype=np.float32)
        return np.zeros((n, 1), dtype=np.float32)


class EnergyShaping(Baseline):
    r"""Swing-up of the pendulum: energy shaping below, a linear-quadratic regulator near the top.

    *Below*, the torque is the one whose work over the coming control period would bring the
    pendulum's energy to that of standing upright, saturated:
    :math:`\tau = -(E - E_{up}) / (\bar\omega T) + b\bar\omega` with :math:`\bar\omega` the mean
    speed expected over the period. It pumps at full torque while energy is missing, brakes where
    there is too much, and leaves the pendulum on the orbit that runs into the upright equilibrium.

    *Near the top*, :math:`\tau = -K x` with K the discrete LQR gain of the plant linearized upright
    and held exactly over the control period. It takes over inside its own region of attraction,
    torque limit included: at construction the regulated plant is simulated from a grid of states,
    and those from which it comes to rest upright form the region.

    Source: Åström and Furuta (2000), *Swinging up a pendulum by energy control*, Automatica 36.

    Args:
        setup: of the environment.
    """

    policy_id = "handmade"

    def __init__(self, setup: Setup) -> None:
        plant = setup.plant
        assert isinstance(plant, Pendulum)
        self.plant = plant
        self.limit = float(setup.task.control_limit)
        self.period = setup.timing.control_period
        self.rate = math.sqrt(plant.gravity_torque / plant.inertia)
        a, b = held(*linearized(plant), self.period)
        weights = np.diag([1.0, 1.0 / self.rate**2])
        effort = np.array([[1.0 / plant.gravity_torque**2]])
        self.gain = lqr_gain(a, b, weights, effort)[0]
        self.region = _Region.of(self)

    def parameters(self) -> dict[str, Any]:
        """The plant, the torque limit and the control period."""
        return {"plant": asdict(self.plant), "limit": self.limit, "period": self.period}

    def act(self, observations: NDArray[Any]) -> FloatArray:
        """Torques.

        Args:
            observations: (cos θ, sin θ, θ̇), shape (n, 3), θ̇ in rad/s.

        Returns:
            N m, float32 of shape (n, 1), within the limit.
        """
        cosine, sine, speed = np.asarray(observations, dtype=np.float64).T
        angle = np.arctan2(sine, cosine)
        torque = np.where(
            self.region.holds(angle, speed), self.regulate(angle, speed), self.pump(angle, speed)
        )
        return torque.astype(np.float32)[:, None]

    def regulate(self, angle: NDArray[Any], speed: NDArray[Any]) -> NDArray[np.float64]:
        """Saturated LQR torques in N m, shape (n,), of angles in rad and speeds in rad/s."""
        return _within(-(self.gain[0] * angle + self.gain[1] * speed), self.limit)

    def pump(self, angle: NDArray[Any], speed: NDArray[Any]) -> NDArray[np.float64]:
        """Energy-shaping torques in N m, shape (n,), of angles in rad and speeds in rad/s."""
        plant, period = self.plant, self.period
        (free,) = plant.acceleration(ARRAY, (angle,), (speed,), (0.0,))
        mean_speed = speed + 0.5 * period * free
        excess = plant.energy(ARRAY, (angle,), (speed,)) - 2.0 * plant.gravity_torque
        floor = np.copysign(1e-9, mean_speed)
        advance = period * np.where(np.abs(mean_speed) < 1e-9, floor, mean_speed)
        return _within(-excess / advance + plant.damping * mean_speed, self.limit)


def _within(control: NDArray[Any], limit: float) -> NDArray[np.float64]:
    """Controls saturated at ±``limit``."""
    within: NDArray[np.float64] = np.clip(control, -limit, limit)
    return within


class _Region:
    """States (θ, θ̇) from which the regulator brings a pendulum to rest upright.

    Args:
        angles: grid over θ, rad, ascending and evenly spaced, shape (rows,).
        speeds: grid over θ̇, rad/s, likewise, shape (columns,).
        caught: whether each grid point belongs to the region, shape (rows, columns).
    """

    def __init__(
        self, angles: NDArray[Any], speeds: NDArray[Any], caught: NDArray[np.bool_]
    ) -> None:
        self.angles, self.speeds = angles, speeds
        self.cells = caught[:-1, :-1] & caught[1:, :-1] & caught[:-1, 1:] & caught[1:, 1:]

    @classmethod
    def of(cls, controller: EnergyShaping) -> _Region:
        """Simulate the regulated plant from a grid of states."""
        angles = np.linspace(-1.0, 1.0, 61)
        speeds = np.linspace(-2.0 * controller.rate, 2.0 * controller.rate, 61)
        angle, speed = (grid.ravel() for grid in np.meshgrid(angles, speeds, indexing="ij"))
        period = controller.period
        substeps = math.ceil(period * controller.rate / _STEP_RATE)
        engine = NativeEngine(PlantSystem(controller.plant), "rk4", period / substeps)
        upright = np.ones(angle.shape, dtype=bool)
        for _ in range(math.ceil(_CATCH_TIME / period)):
            torque = controller.regulate(wrapped(ARRAY, angle), speed)
            motion = engine.advance(ARRAY, (angle,), (speed,), ((torque, substeps),), None)
            (angle,), (speed,) = motion.q, motion.v
            upright &= np.abs(angle) < 0.5 * math.pi
        caught = upright & (np.abs(angle) < _CATCH_ANGLE)
        return cls(angles, speeds, caught.reshape(len(angles), len(speeds)))

    def holds(self, angle: NDArray[Any], speed: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether states lie in a grid cell whose four corners are caught; shape (n,)."""
        rows, row_inside = _cell(self.angles, angle)
        columns, column_inside = _cell(self.speeds, speed)
        inside: NDArray[np.bool_] = row_inside & column_inside & self.cells[rows, columns]
        return inside


def _cell(grid: NDArray[Any], values: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Index of the interval that each value lies in, and whether it lies in the grid at all."""
    position = (values - grid[0]) / (grid[1] - grid[0])
    inside = (position >= 0.0) & (position < len(grid) - 1)
    return np.where(inside, position, 0.0).astype(np.int64), inside


class BangBangRegulator(Baseline):
    r"""Balance of the cart-pole: the linear-quadratic regulator's force, rounded to ±F.

    With K the discrete LQR gain of the plant linearized upright and held exactly over the control
    period, the action pushes towards +x where :math:`-Kx > 0`, else towards -x. Of the two forces
    this is the one after which the LQR's cost-to-go :math:`x^\top P x` is least, because
    :math:`Kx` is a positive multiple of :math:`B^\top P A x`. The pole keeps rocking by about
    what one push does.

    Args:
        setup: of the environment.
    """

    policy_id = "handmade"

    def __init__(self, setup: Setup) -> None:
        plant, task = setup.plant, setup.task
        assert isinstance(plant, CartPole)
        assert isinstance(task, CartPoleBalance)
        self.plant = plant
        self.limit = float(task.control_limit)
        self.period = setup.timing.control_period
        self.thresholds = (task.x_threshold, task.theta_threshold)
        rate = math.sqrt(plant.gravity / plant.length)
        scales = np.outer(self.thresholds, (1.0, rate)).ravel()
        a, b = held(*linearized(plant), self.period)
        self.gain = lqr_gain(a, b, np.diag(scales**-2.0), np.array([[self.limit**-2.0]]))[0]

    def parameters(self) -> dict[str, Any]:
        """The plant, the force, the control period and the thresholds that scale the cost."""
        return {
            "plant": asdict(self.plant),
            "limit": self.limit,
            "period": self.period,
            "thresholds": self.thresholds,
        }

    def act(self, observations: NDArray[Any]) -> NDArray[np.int64]:
        """Actions.

        Args:
            observations: (x, ẋ, θ, θ̇), shape (n, 4), SI units.

        Returns:
            1 (towards +x) or 0 (towards -x), int64 of shape (n,).
        """
        force: NDArray[np.float64] = -(np.asarray(observations, dtype=np.float64) @ self.gain)
        return np.where(force > 0.0, 1, 0)


class CartPoleEnergyShaping(Baseline):
    r"""Swing-up of the cart-pole: energy shaping with a centred cart, then a regulator.

    *Below*, the force is the one that gives the cart the acceleration

    .. math::
        a = \operatorname{sat}(3 g (E - E_{up}) / E_{up}) \operatorname{sgn}(\dot\theta \cos\theta)
        - 2 T \cos\theta / (m l) - \omega^2 x - 2 \omega \dot x,

    saturated. The first term raises the energy E of the pole about its hinge towards that of
    standing upright, since :math:`\dot E = -m l \cos\theta\, \dot\theta\, a - T \dot\theta` with T
    the torque of damping and friction, for which the second makes up on average. The others draw
    the cart to the middle, more slowly than the pole swings.

    *Near the top*, :math:`F = -K x`, saturated, with K the discrete LQR gain of the plant
    linearized upright and held exactly over the control period. It takes over where its
    cost-to-go :math:`x^\top P x` is below a level that is found at construction: from every
    sampled state on that ellipsoid and on smaller ones the regulated plant, stops and force limit
    included, comes to rest upright.

    Source: Åström and Furuta (2000), *Swinging up a pendulum by energy control*, Automatica 36;
    Chung and Hauser (1995), *Nonlinear control of a swinging pendulum*, Automatica 31.

    Args:
        setup: of the environment.
    """

    policy_id = "handmade"

    def __init__(self, setup: Setup) -> None:
        plant, task = setup.plant, setup.task
        assert isinstance(plant, CartPole)
        assert isinstance(task, CartPoleSwingUp)
        self.plant = plant
        self.limit = float(task.control_limit)
        self.track = float(task.track_limit)
        self.period = setup.timing.control_period
        self.rate = math.sqrt(plant.mass_moment * plant.gravity / plant.inertia)
        scales = np.array([0.5 * self.track, self.track * self.rate, 0.3, 0.3 * self.rate])
        a, b = held(*linearized(plant), self.period)
        effort = np.array([[self.limit**-2.0]])
        self.gain, self.cost = lqr(a, b, np.diag(scales**-2.0), effort)
        self.level = self._caught_level()

    def parameters(self) -> dict[str, Any]:
        """The plant, the force limit, the length of the track and the control period."""
        return {
            "plant": asdict(self.plant),
            "limit": self.limit,
            "track": self.track,
            "period": self.period,
        }

    def act(self, observations: NDArray[Any]) -> FloatArray:
        """Forces.

        Args:
            observations: (x, ẋ, cos θ, sin θ, θ̇), shape (n, 5), SI units.

        Returns:
            N, float32 of shape (n, 1), within the limit.
        """
        x, x_dot, cosine, sine, theta_dot = np.asarray(observations, dtype=np.float64).T
        state = np.array([x, x_dot, np.arctan2(sine, cosine), theta_dot])
        near = self._cost_to_go(state) <= self.level
        force = np.where(near, self.regulate(state), self.pump(state))
        return force.astype(np.float32)[:, None]

    def regulate(self, state: NDArray[Any]) -> NDArray[np.float64]:
        """Saturated LQR forces in N, shape (n,), of states of shape (4, n)."""
        return _within(-(self.gain @ state)[0], self.limit)

    def pump(self, state: NDArray[Any]) -> NDArray[np.float64]:
        """Energy-shaping forces in N, shape (n,), of states of shape (4, n)."""
        plant, (x, x_dot, theta, theta_dot) = self.plant, state
        upright = 2.0 * plant.mass_moment * plant.gravity
        still = np.zeros_like(x)
        energy = plant.energy(ARRAY, (x, theta), (still, theta_dot))
        fastest = self.limit / plant.total_mass
        wanted = 3.0 * plant.gravity * (energy - upright) / upright
        cosine, slow = np.cos(theta), 0.3 * self.rate
        resistance = plant.damping * theta_dot + plant.friction * np.sign(theta_dot)
        acceleration = np.clip(wanted, -0.7 * fastest, 0.7 * fastest)
        acceleration *= np.copysign(1.0, theta_dot * cosine)
        acceleration -= 2.0 * cosine * resistance / plant.mass_moment
        acceleration -= slow * (slow * x + 2.0 * x_dot)
        free, driven = (
            plant.acceleration(ARRAY, (x, theta), (x_dot, theta_dot), (force, 0.0))[0]
            for force in (0.0, 1.0)
        )
        return _within((acceleration - free) / (driven - free), self.limit)

    def _cost_to_go(self, state: NDArray[Any]) -> NDArray[np.float64]:
        cost: NDArray[np.float64] = np.einsum("in,ij,jn->n", state, self.cost, state)
        return cost

    def _caught_level(self) -> float:
        """Largest cost-to-go of a ladder up to which the regulator catches every sampled state."""
        directions = np.random.default_rng(0).normal(size=(4, _DIRECTIONS))
        directions /= np.sqrt(self._cost_to_go(directions))
        widest = 1.0 / np.linalg.inv(self.cost)[2, 2]  # where the ellipsoid reaches 1 rad
        levels = widest * np.linspace(0.1, 1.0, 19) ** 2
        starts = directions[:, :, None] * np.sqrt(levels)
        caught = self._caught(starts.reshape(4, -1)).reshape(_DIRECTIONS, -1).all(axis=0)
        return float(levels[: int(np.cumprod(caught).sum())].max(initial=0.0))

    def _caught(self, state: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether the regulated plant comes to rest upright, shape (n,), from states (4, n)."""
        substeps = math.ceil(self.period * self.rate / _STEP_RATE)
        engine = NativeEngine(PlantSystem(self.plant), "rk4", self.period / substeps)
        upright = np.ones(state.shape[1], dtype=bool)
        for _ in range(math.ceil(_CATCH_TIME / self.period)):
            q, v = split_state(tuple(state))
            force = self.regulate(state)
            motion = engine.advance(ARRAY, q, v, ((force, substeps),), None)
            state = np.array(join_state(motion.q, motion.v))
            upright &= (np.abs(state[2]) < 0.5 * math.pi) & (np.abs(state[0]) <= self.track)
        caught: NDArray[np.bool_] = upright & (np.abs(state[2]) < _CATCH_ANGLE)
        return caught


class SwingRegulator(Baseline):
    r"""Quieting of the elastic pendulum: the linear-quadratic regulator of its swing, saturated.

    :math:`F = -K (x, \dot x)` with K the discrete LQR gain of the swing, linearized at rest and
    held exactly over the control period. A horizontal force does not reach the bounce of a
    hanging spring, which is left alone.

    Args:
        setup: of the environment.
    """

    policy_id = "handmade"

    def __init__(self, setup: Setup) -> None:
        plant = setup.plant
        assert isinstance(plant, ElasticPendulum)
        self.plant = plant
        self.limit = float(setup.task.control_limit)
        self.period = setup.timing.control_period
        rate = math.sqrt(plant.gravity / plant.hanging_length)
        a, b = linearized(plant)
        swing = held(a[:2, :2], b[:2], self.period)
        weights = np.diag([1.0, rate**-2.0]) / NEAR_PLUMB**2
        self.gain = lqr_gain(*swing, weights, np.array([[self.limit**-2.0]]))[0]

    def parameters(self) -> dict[str, Any]:
        """The plant, the force limit and the control period."""
        return {"plant": asdict(self.plant), "limit": self.limit, "period": self.period}

    def act(self, observations: NDArray[Any]) -> FloatArray:
        """Forces.

        Args:
            observations: (x, ẋ, y, ẏ), shape (n, 4), SI units.

        Returns:
            N, float32 of shape (n, 1), within the limit.
        """
        swing = np.asarray(observations, dtype=np.float64)[:, :2]
        force = _within(-(swing @ self.gain), self.limit)
        return force.astype(np.float32)[:, None]


_HANDMADE: dict[type[Any], Callable[[Setup], Policy]] = {
    PendulumSwingUp: EnergyShaping,
    CartPoleBalance: BangBangRegulator,
    CartPoleSwingUp: CartPoleEnergyShaping,
    ElasticPendulumQuiet: SwingRegulator,
}
