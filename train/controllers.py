"""Hand-made controllers: of the pendulum, the cart-pole and the elastic pendulum."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.engines.stepping import NativeEngine
from integ_gym.envs.ops.ops import ARRAY, SCALAR, join_state, split_state
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.elastic_pendulum import ElasticPendulum
from integ_gym.envs.plants.interface import Plant
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.settings import Setup
from integ_gym.envs.tasks.cart_pole import CartPoleBalance, CartPoleSwingUp
from integ_gym.envs.tasks.elastic_pendulum import NEAR_PLUMB
from integ_gym.envs.tasks.interface import wrap_angle
from integ_gym.support.errors import InputError
from integ_gym.support.optional import load

from .baselines import Baseline
from .policy import ActionArray

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


Matrix: TypeAlias = NDArray[np.float64]

_STEP = 1e-5
"""Half-width of the central differences: their error is below 1e-9 on our plants."""


def linearize(plant: Plant, about: Matrix | None = None) -> tuple[Matrix, Matrix]:
    """ẋ = A x + B u of a plant near a point where it rests, of deviations from it.

    Args:
        plant: with numbers, not arrays, as parameters.
        about: the point, state and controls, in state order and SI units, shape (n + controls,);
            None: zeros, which is upright without control.

    Returns:
        A of shape (n, n) and B of shape (n, controls), in state order and SI units.
    """
    n, system = 2 * len(plant.coordinates), PlantSystem(plant)

    def rate(point: Matrix) -> Matrix:
        q, v = split_state(tuple(point[:n].tolist()))
        force = system.forces(SCALAR, q, v, tuple(point[n:].tolist()))
        return np.array(join_state(v, plant.acceleration(SCALAR, q, v, force)))

    directions = np.eye(n + len(plant.controls))
    rest = np.zeros(len(directions)) if about is None else about
    slopes = [(rate(rest + _STEP * e) - rate(rest - _STEP * e)) / (2.0 * _STEP) for e in directions]
    jacobian = np.column_stack(slopes)
    return jacobian[:, :n], jacobian[:, n:]


def discretize_zoh(a: Matrix, b: Matrix, period: float) -> tuple[Matrix, Matrix]:
    """The exact discrete map of ẋ = A x + B u with u held constant over ``period`` seconds.

    Source: Van Loan (1978), Computing integrals involving the matrix exponential.
    """
    expm = load("scipy.linalg", "report").expm
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a, b
    exponential = np.asarray(expm(period * block), dtype=np.float64)
    return exponential[:n, :n], exponential[:n, n:]


def lqr_gain(a: Matrix, b: Matrix, state_cost: Matrix, control_cost: Matrix) -> Matrix:
    """K, shape (m, n), of :func:`lqr`."""
    return lqr(a, b, state_cost, control_cost)[0]


def lqr(a: Matrix, b: Matrix, state_cost: Matrix, control_cost: Matrix) -> tuple[Matrix, Matrix]:
    """K of the control u = -K x that minimizes Σ xᵀ Q x + uᵀ R u over x ← A x + B u, and its cost.

    Args:
        a: shape (n, n).
        b: shape (n, m).
        state_cost: Q, shape (n, n), positive semidefinite.
        control_cost: R, shape (m, m), positive definite.

    Returns:
        K of shape (m, n), and P of shape (n, n): the least sum from x on is xᵀ P x.

    Raises:
        ValueError: if no control stabilizes the system.
    """
    linalg = load("scipy.linalg", "report")
    try:
        value = linalg.solve_discrete_are(a, b, state_cost, control_cost)
    except np.linalg.LinAlgError as error:
        raise InputError(
            "no linear control holds this plant upright; give it gravity and a control that acts"
        ) from error
    gain = np.linalg.solve(control_cost + b.T @ value @ b, b.T @ value @ a)
    return np.asarray(gain), np.asarray(value)


_CATCH_TIME = 4.0
"""How long the regulator may take, in simulation, to bring a state near upright, s."""
_CATCH_ANGLE = 0.1
"""How near upright it must then be, rad."""
_STEP_RATE = 0.1
"""Largest integration step of that simulation times the rate of the plant."""


def caught(
    plant: Plant,
    regulate: Callable[[NDArray[Any]], NDArray[np.float64]],
    state: NDArray[np.float64],
    *,
    period: float,
    rate: float,
    limits: tuple[float, ...] = (),
) -> NDArray[np.bool_]:
    """Whether the regulated plant comes to rest upright from some states.

    Args:
        plant: whose last coordinate is the angle from upright, rad.
        regulate: controls in N or N m, shape (n,), of states.
        state: where the plant starts, in its state order and SI units, shape (2 coordinates, n).
        period: control period, s.
        rate: of the plant's pendulum, rad/s.
        limits: of the coordinates before the angle, which are not to be left, SI units.

    Returns:
        Shape (n,).
    """
    substeps = math.ceil(period * rate / _STEP_RATE)
    engine = NativeEngine(PlantSystem(plant), "rk4", period / substeps)
    bounds = np.array([*limits, 0.5 * math.pi])[:, None]
    inside = np.ones(state.shape[1], dtype=bool)
    for _ in range(math.ceil(_CATCH_TIME / period)):
        q, v = split_state(tuple(state))
        motion = engine.advance(ARRAY, q, v, (((regulate(state),), substeps),), None)
        state = np.array(join_state(motion.q, motion.v))
        inside &= (np.abs(np.array(motion.q)) <= bounds).all(axis=0)
    near: NDArray[np.bool_] = inside & (np.abs(state[-2]) < _CATCH_ANGLE)
    return near


P = TypeVar("P", bound="DataclassInstance")


class HandMade(Baseline, Generic[P]):
    """A controller that is designed from a plant's own parameters, for one task.

    Args:
        setup: of the environment.
    """

    policy_id = "handmade"
    plant_class: ClassVar[type[Any]]
    """Class of the plant that the task has; the module is named as the task's."""

    def __init__(self, setup: Setup) -> None:
        assert isinstance(setup.plant, self.plant_class)
        self.plant: P = setup.plant
        self.limit = setup.largest_controls[0]
        self.period = setup.timing.control_period

    def parameters(self) -> dict[str, Any]:
        """The plant, the limit of the control and the control period."""
        return {"plant": asdict(self.plant), "limit": self.limit, "period": self.period}

    def act(self, observations: NDArray[Any]) -> ActionArray:
        """Actions of a `Box` space.

        Args:
            observations: shape (n, obs_dim), SI units.

        Returns:
            The controls, float32 of shape (n, number of controls).
        """
        controls = self.control(np.asarray(observations, dtype=np.float64))
        return controls.astype(np.float32).reshape(-1, len(self.plant_class.controls))

    def control(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Controls in N or N m of observations of shape (n, obs_dim).

        Their shape is (n,), or (n, number of controls) of several.
        """
        raise NotImplementedError

    def saturated(self, control: NDArray[np.float64]) -> NDArray[np.float64]:
        """Controls within the limit."""
        return np.clip(control, -self.limit, self.limit)


class EnergyShaping(HandMade[Pendulum]):
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

    plant_class = Pendulum

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        plant = self.plant
        self.rate = math.sqrt(plant.gravity_torque / plant.inertia)
        a, b = discretize_zoh(*linearize(plant), self.period)
        weights = np.diag([1.0, 1.0 / self.rate**2])
        effort = np.array([[1.0 / plant.gravity_torque**2]])
        self.gain = lqr_gain(a, b, weights, effort)[0]
        self.region = _Region.of(self)

    def control(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Torques in N m, shape (n,), of (cos θ, sin θ, θ̇ in rad/s), shape (n, 3)."""
        cosine, sine, speed = observations.T
        angle = np.arctan2(sine, cosine)
        return np.where(
            self.region.holds(angle, speed), self.regulate(angle, speed), self.pump(angle, speed)
        )

    def regulate(self, angle: NDArray[Any], speed: NDArray[Any]) -> NDArray[np.float64]:
        """Saturated LQR torques in N m, shape (n,), of angles in rad and speeds in rad/s."""
        return self.saturated(-(self.gain[0] * angle + self.gain[1] * speed))

    def pump(self, angle: NDArray[Any], speed: NDArray[Any]) -> NDArray[np.float64]:
        """Energy-shaping torques in N m, shape (n,), of angles in rad and speeds in rad/s."""
        plant, period = self.plant, self.period
        (free,) = plant.acceleration(ARRAY, (angle,), (speed,), (0.0,))
        mean_speed = speed + 0.5 * period * free
        excess = plant.energy(ARRAY, (angle,), (speed,)) - 2.0 * plant.gravity_torque
        floor = np.copysign(1e-9, mean_speed)
        advance = period * np.where(np.abs(mean_speed) < 1e-9, floor, mean_speed)
        return self.saturated(-excess / advance + plant.damping * mean_speed)


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
        states = np.array([grid.ravel() for grid in np.meshgrid(angles, speeds, indexing="ij")])
        held_upright = caught(
            controller.plant,
            lambda state: controller.regulate(wrap_angle(ARRAY, state[0]), state[1]),
            states,
            period=controller.period,
            rate=controller.rate,
        )
        return cls(angles, speeds, held_upright.reshape(len(angles), len(speeds)))

    def holds(self, angle: NDArray[Any], speed: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether states lie in a grid cell whose four corners are caught; shape (n,)."""
        rows, row_inside = _cell(self.angles, angle)
        columns, column_inside = _cell(self.speeds, speed)
        return row_inside & column_inside & self.cells[rows, columns]


def _cell(grid: NDArray[Any], values: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Index of the interval that each value lies in, and whether it lies in the grid at all."""
    position = (values - grid[0]) / (grid[1] - grid[0])
    inside = (position >= 0.0) & (position < len(grid) - 1)
    return np.where(inside, position, 0.0).astype(np.int64), inside


def cost_to_go(cost: Matrix, state: NDArray[Any]) -> NDArray[np.float64]:
    """xᵀ P x of deviations from rest, shape (n,), of shape (states, n)."""
    total: NDArray[np.float64] = np.einsum("in,ij,jn->n", state, cost, state)
    return total


def caught_level(
    cost: Matrix, angle: int, count: int, is_held: Callable[[Matrix], NDArray[np.bool_]]
) -> float:
    """Largest cost-to-go of a ladder up to which a regulator catches every sampled deviation.

    Args:
        cost: P, shape (states, states).
        angle: place of the angle from upright in a state.
        count: of directions of the state space that are tried.
        is_held: which of some deviations, shape (states, n), come to rest.
    """
    directions = np.random.default_rng(0).normal(size=(len(cost), count))
    directions /= np.sqrt(cost_to_go(cost, directions))
    widest = 1.0 / np.linalg.inv(cost)[angle, angle]  # where the ellipsoid reaches 1 rad
    levels = widest * np.linspace(0.1, 1.0, 19) ** 2
    starts = (directions[:, :, None] * np.sqrt(levels)).reshape(len(cost), -1)
    every = is_held(starts).reshape(count, -1).all(axis=0)
    return float(levels[: int(np.cumprod(every).sum())].max(initial=0.0))


class CartPoleEnergyShaping(HandMade[CartPole]):
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

    plant_class = CartPole

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        plant, task = self.plant, setup.task
        assert isinstance(task, CartPoleSwingUp)
        self.track = float(task.track_limit)
        self.rate = math.sqrt(plant.mass_moment * plant.gravity / plant.inertia)
        scales = np.array([0.5 * self.track, self.track * self.rate, 0.3, 0.3 * self.rate])
        a, b = discretize_zoh(*linearize(plant), self.period)
        effort = np.array([[self.limit**-2.0]])
        self.gain, self.cost = lqr(a, b, np.diag(scales**-2.0), effort)
        catch = partial(caught, plant, self.regulate, period=self.period, rate=self.rate)
        is_held = partial(catch, limits=(self.track,))
        self.level = caught_level(self.cost, 2, 64, is_held)

    def parameters(self) -> dict[str, Any]:
        """The plant, the force limit, the length of the track and the control period."""
        return {**super().parameters(), "track": self.track}

    def control(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Forces in N, shape (n,), of (x, ẋ, cos θ, sin θ, θ̇) in SI units, shape (n, 5)."""
        x, x_dot, cosine, sine, theta_dot = observations.T
        state = np.array([x, x_dot, np.arctan2(sine, cosine), theta_dot])
        near = cost_to_go(self.cost, state) <= self.level
        return np.where(near, self.regulate(state), self.pump(state))

    def regulate(self, state: NDArray[Any]) -> NDArray[np.float64]:
        """Saturated LQR forces in N, shape (n,), of states of shape (4, n)."""
        return self.saturated(-(self.gain @ state)[0])

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
        return self.saturated((acceleration - free) / (driven - free))


class BangBangRegulator(HandMade[CartPole]):
    r"""Balance of the cart-pole: the linear-quadratic regulator's force, rounded to ±F.

    With K the discrete LQR gain of the plant linearized upright and held exactly over the control
    period, the action pushes towards +x where :math:`-Kx > 0`, else towards -x. Of the two forces
    this is the one after which the LQR's cost-to-go :math:`x^\top P x` is least, because
    :math:`Kx` is a positive multiple of :math:`B^\top P A x`. The pole keeps rocking by about
    what one push does.

    Args:
        setup: of the environment.
    """

    plant_class = CartPole

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        plant, task = self.plant, setup.task
        assert isinstance(task, CartPoleBalance)
        self.thresholds = (task.x_threshold, task.theta_threshold)
        rate = math.sqrt(plant.gravity / plant.length)
        scales = np.outer(self.thresholds, (1.0, rate)).ravel()
        a, b = discretize_zoh(*linearize(plant), self.period)
        self.gain = lqr_gain(a, b, np.diag(scales**-2.0), np.array([[self.limit**-2.0]]))[0]

    def parameters(self) -> dict[str, Any]:
        """The plant, the force, the control period and the thresholds that scale the cost."""
        return {**super().parameters(), "thresholds": self.thresholds}

    def act(self, observations: NDArray[Any]) -> NDArray[np.int64]:
        """Actions.

        Args:
            observations: (x, ẋ, θ, θ̇), shape (n, 4), SI units.

        Returns:
            1 (towards +x) or 0 (towards -x), int64 of shape (n,).
        """
        return np.where(self.control(np.asarray(observations, dtype=np.float64)) > 0.0, 1, 0)

    def control(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        """The regulator's forces in N, not saturated, shape (n,), of (x, ẋ, θ, θ̇), shape (n, 4)."""
        force: NDArray[np.float64] = -(observations @ self.gain)
        return force


class SwingRegulator(HandMade[ElasticPendulum]):
    r"""Quieting of the elastic pendulum: the linear-quadratic regulator of its swing, saturated.

    :math:`F = -K (x, \dot x)` with K the discrete LQR gain of the swing, linearized at rest and
    held exactly over the control period. A horizontal force does not reach the bounce of a
    hanging spring, which is left alone.

    Args:
        setup: of the environment.
    """

    plant_class = ElasticPendulum

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        plant = self.plant
        rate = math.sqrt(plant.gravity / plant.hanging_length)
        a, b = linearize(plant)
        swing = discretize_zoh(a[:2, :2], b[:2], self.period)
        weights = np.diag([1.0, rate**-2.0]) / NEAR_PLUMB**2
        self.gain = lqr_gain(*swing, weights, np.array([[self.limit**-2.0]]))[0]

    def control(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Forces in N, shape (n,), of (x, ẋ, y, ẏ) in SI units, shape (n, 4)."""
        return self.saturated(-(observations[:, :2] @ self.gain))
