"""Hand-made controllers of the acrobot."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.engines.stepping import NativeEngine
from integ_gym.envs.ops.ops import ARRAY, SCALAR
from integ_gym.envs.plants.double_pendulum import Acrobot
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.settings import Setup
from integ_gym.envs.tasks.interface import wrap_angle

from .controllers import HandMade, Matrix, caught_level, cost_to_go, discretize_zoh, lqr
from .policy import ActionArray


class AcrobotPump(HandMade[Acrobot]):
    r"""Swing the acrobot's tip up: the torque of the elbow's own direction, which always does work.

    The torque does the work :math:`\tau\dot\theta_2` per second, so that its sign is that of
    :math:`\dot\theta_2`.

    Source: DeJong and Spong (1994), *Swinging up the acrobot: an example of intelligent control*,
    American Control Conference.

    Args:
        setup: of the environment.
    """

    plant_class = Acrobot

    def act(self, observations: NDArray[Any]) -> ActionArray:
        """Actions 2 where the second joint turns counter-clockwise, else 0; int64, shape (n,)."""
        return np.where(np.asarray(observations)[:, 5] > 0.0, 2, 0).astype(np.int64)


UPRIGHT = (math.pi, 0.0, 0.0, 0.0)
"""(θ₁, θ₂, θ̇₁, θ̇₂), the order that this file's states have."""

_STRAIGHTEN, _CALM, _PUMP, _LARGEST = 5.0, 2.0, 2.0, 40.0
"""Stiffness, 1/s², and damping, 1/s, of the second angle, gain of the pump, 1/(J s), and its limit,
rad/s²: those of two hundred drawn at random that solve most starts."""

_DIRECTIONS, _STEP, _CATCH_TIME = 400, 0.01, 4.0
"""Directions in which the regulator is tried, integration step and time to bring rest in, s."""


class AcrobotEnergyShaping(HandMade[Acrobot]):
    r"""Swing-up of the acrobot: energy shaping of the linearized second joint, then a regulator.

    *Below*, the torque is the one that gives the second joint the acceleration

    .. math:: a = -k_p\theta_2 - k_d\dot\theta_2
        - \operatorname{sat}(k_E (E_{up} - E)\,\dot\theta_1),

    saturated, with E the energy: the last term swings the second link against the first where
    energy is missing. *Near the top*, :math:`\tau = -K x`, saturated, with K the discrete LQR gain
    of the plant linearized upright and held exactly over the control period. It takes over where
    its cost-to-go :math:`x^\top P x` is below twice the level up to which, at construction, the
    regulated plant comes to rest upright from every sampled state.

    Source: Spong (1996), *Energy based control of a class of underactuated mechanical systems*,
    IFAC World Congress; Spong (1995), *The swing up control problem for the acrobot*.

    Args:
        setup: of the environment.
    """

    plant_class = Acrobot

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        plant = self.plant
        rest = tuple(UPRIGHT[:2]), tuple(UPRIGHT[2:])
        self.top = float(plant.energy(SCALAR, *rest))
        by_q, by_v = plant.jacobian(SCALAR, *rest, (0.0, 0.0))
        a = np.block([[np.zeros((2, 2)), np.eye(2)], [np.array(by_q), np.array(by_v)]])
        pushed = plant.acceleration(SCALAR, *rest, (0.0, 1.0))
        b = np.array([[0.0], [0.0], [pushed[0]], [pushed[1]]])
        weights, effort = np.diag([1.0, 1.0, 0.1, 0.1]), np.array([[self.limit**-2.0]])
        self.gain, self.cost = lqr(*discretize_zoh(a, b, self.period), weights, effort)
        self.level = 2.0 * caught_level(self.cost, 0, _DIRECTIONS, self._is_held)

    def control(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Torques in N m, shape (n,), of observations in SI units, shape (n, 6)."""
        cos_1, sin_1, cos_2, sin_2, speed_1, speed_2 = observations.T
        state = np.array([np.arctan2(sin_1, cos_1), np.arctan2(sin_2, cos_2), speed_1, speed_2])
        near = cost_to_go(self.cost, _away(state)) <= self.level
        return np.where(near, self.regulate(state), self.pump(state))

    def regulate(self, state: NDArray[Any]) -> NDArray[np.float64]:
        """Saturated LQR torques in N m, shape (n,), of states of shape (4, n)."""
        return self.saturated(-(self.gain @ _away(state))[0])

    def pump(self, state: NDArray[Any]) -> NDArray[np.float64]:
        """Energy-shaping torques in N m, shape (n,), of states of shape (4, n)."""
        plant, q, v = self.plant, tuple(state[:2]), tuple(state[2:])
        free = plant.acceleration(ARRAY, q, v, (0.0, 0.0))[1]
        response = plant.acceleration(ARRAY, q, v, (0.0, 1.0))[1] - free
        missing = self.top - plant.energy(ARRAY, q, v)
        swing = np.clip(_PUMP * missing * v[0], -_LARGEST, _LARGEST)
        asked = -_STRAIGHTEN * wrap_angle(ARRAY, q[1]) - _CALM * v[1] - swing
        return self.saturated((asked - free) / response)

    @np.errstate(all="ignore")
    def _is_held(self, offsets: Matrix) -> NDArray[np.bool_]:
        """Whether the regulated plant comes to rest upright, of deviations of shape (4, n)."""
        state: Matrix = np.array(UPRIGHT)[:, None] + offsets
        substeps = math.ceil(self.period / _STEP)
        engine = NativeEngine(PlantSystem(self.plant), "rk4", self.period / substeps)
        for _ in range(math.ceil(_CATCH_TIME / self.period)):
            control = self.regulate(state)
            motion = engine.advance(
                ARRAY, tuple(state[:2]), tuple(state[2:]), (((control,), substeps),), None
            )
            state = np.array((*motion.q, *motion.v))
        first, second = np.abs(_away(state)[:2]) < 0.1
        held: NDArray[np.bool_] = first & second
        return held


def _away(state: NDArray[Any]) -> NDArray[np.float64]:
    """Distance of states from rest upright, angles wrapped, shape (4, n)."""
    turned = [wrap_angle(ARRAY, state[0] - math.pi), wrap_angle(ARRAY, state[1])]
    return np.array([*turned, *state[2:]])
