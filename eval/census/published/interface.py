"""What is told of a library of environments."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any, ClassVar

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.ops.ops import SCALAR, Components
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.interface import Plant
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.support.errors import InputError
from integ_gym.support.isolated import Apart
from integ_gym.support.optional import package_version

from ..subjects import Access, Settable, Statement, Subject


class Library(ABC):
    """A library that publishes a pendulum or a cart-pole."""

    title: ClassVar[str]
    """Its name, as people write it."""
    package: ClassVar[str]
    """The distribution whose version is told."""
    modules: ClassVar[tuple[str, ...]]
    """What has to be importable."""
    apart: ClassVar[Apart | None] = None
    """The environment of its own that it runs in, if it has one."""
    install: ClassVar[str]
    """The command that makes it so."""

    @abstractmethod
    def subjects(self) -> Iterator[Subject]:
        """Its environments."""

    def subject(
        self,
        name: str,
        plant: Plant,
        stated: Statement,
        max_control: float,
        access: Access,
        **more: Any,
    ) -> Subject:
        """One of its environments; see :class:`Subject`."""
        told = package_version(self.package) if self.apart is None else self.apart.version()
        version = told or "unknown"
        return Subject(self.title, name, version, True, plant, stated, max_control, access, **more)

    def pendulum(
        self, name: str, parameters: Any, max_control: float, step: numerics.OneStep, note: str = ""
    ) -> Subject:
        """A pendulum in float32 whose parameters have Gymnasium's names."""
        plant = Pendulum(mass=parameters.m, length=parameters.l, gravity=parameters.g)
        stated = Statement(parameters.dt, max_speed=parameters.max_speed)
        return self.subject(name, plant, stated, max_control, Settable(step), width=32, note=note)

    def cart_pole(
        self, name: str, parameters: Any, step: numerics.OneStep, words: str = "", **more: Any
    ) -> Subject:
        """A cart-pole whose parameters have Gymnasium's names; Euler's if it names any method."""
        plant = CartPole(
            cart_mass=parameters.masscart,
            mass=parameters.masspole,
            length=parameters.length,
            gravity=parameters.gravity,
        )
        stated = Statement(parameters.tau, map="explicit_euler" if words else None, words=words)
        return self.subject(name, plant, stated, parameters.force_mag, Settable(step), **more)


def jax_step(
    advance: Callable[[Any, Any, Any], tuple[Any, Any]], gear: float = 1.0
) -> numerics.OneStep:
    """One control period by a function of (q, v, action), in float32 as JAX has it by default.

    Args:
        advance: gets arrays of shape (coordinates,), (coordinates,) and (1,); it is compiled.
        gear: the control of an action of 1, N or N m.
    """
    compiled = import_module("jax").jit(advance)

    def advanced(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        end_q, end_v = compiled(*(np.array(x, dtype=np.float32) for x in (q, v, [control / gear])))
        return _numbers(end_q), _numbers(end_v)

    return advanced


def _numbers(values: Any) -> Components:
    return tuple(np.array(values, dtype=np.float64).ravel().tolist())


AGREEMENT = 1e-9
"""Largest relative error of the plant's mass matrix and gravity force."""

PROBES = ((0.3, -0.7), (-0.2, 2.2))
"""Configurations at which the plant is compared with the model."""

INTEGRATORS = {
    "mjINT_EULER": ("symplectic_euler_implicit_damping", "Euler"),
    "mjINT_RK4": ("rk4", "RK4"),
    "mjINT_IMPLICIT": ("symplectic_euler_implicit_velocity", "implicit"),
    "mjINT_IMPLICITFAST": ("symplectic_euler_implicit_damping", "implicitfast"),
}
"""MuJoCo's integrators: the map that its documentation describes, and its name there."""


def plant_of(model: Any) -> Plant:
    """The point mass on a rod, and on a cart, that moves as a model of one hinge does.

    Raises:
        ValueError: if the model moves otherwise.
    """
    n = int(model.nv)
    mass, _ = _dynamics(model, (0.0,) * n)
    _, weight = _dynamics(model, (*(0.0,) * (n - 1), 0.5 * math.pi))
    inertia, torque = float(mass[-1, -1]), float(weight[-1])
    damping = [float(x) for x in model.dof_damping]
    gravity = float(np.linalg.norm(model.opt.gravity))
    same: Any = {"gravity": gravity, "damping": damping[-1], "mass_distribution": "point"}
    made: Plant
    if n == 1:
        length = inertia * gravity / torque
        made = Pendulum(mass=torque**2 / (inertia * gravity**2), length=length, **same)
    else:
        moment = float(mass[0, 1])
        made = CartPole(
            cart_mass=float(mass[0, 0]) - moment**2 / inertia,
            mass=moment**2 / inertia,
            length=inertia / moment,
            cart_damping=damping[0],
            **same,
        )
    _check(model, made)
    return made


def statement_of(model: Any, substeps: int) -> Statement:
    """What a model says of its discretization."""
    mujoco = import_module("mujoco")
    integrator = mujoco.mjtIntegrator(model.opt.integrator).name
    known, words = INTEGRATORS.get(integrator, (None, integrator))
    undamped = bool(model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    if integrator == "mjINT_EULER" and undamped:
        known, words = "symplectic_euler", "Euler, eulerdamp off"
    return Statement(substeps * model.opt.timestep, substeps, known, words)


def control_step(model: Any, substeps: int) -> numerics.OneStep:
    """One control period by ``mj_step``; the control is a force or torque at the joint."""
    mujoco = import_module("mujoco")
    data, n = mujoco.MjData(model), int(model.nv)
    gear = float(model.actuator_gear[0, 0])

    def advanced(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:], data.ctrl[0] = q, v, control / gear
        mujoco.mj_step(model, data, nstep=substeps)
        end = (*data.qpos.tolist(), *data.qvel.tolist())
        return end[:n], end[n:]

    return advanced


def max_control(model: Any) -> float:
    """Largest force or torque of the motor, N or N m."""
    return float(model.actuator_gear[0, 0] * model.actuator_ctrlrange[0, 1])


def _dynamics(model: Any, q: Components) -> tuple[np.ndarray, np.ndarray]:
    """Mass matrix and gravity force at rest."""
    mujoco = import_module("mujoco")
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return mass, -np.array(data.qfrc_bias)


def _check(model: Any, plant: Plant) -> None:
    for probe in PROBES:
        q = probe[-model.nv :]
        mass, weight = _dynamics(model, q)
        expected: np.ndarray = np.array(plant.mass_matrix(SCALAR, q))
        still = (0.0,) * len(q)
        pull = expected @ np.array(plant.acceleration(SCALAR, q, still, still))
        for got, wanted in ((mass, expected), (weight, pull)):
            if not np.allclose(got, wanted, rtol=AGREEMENT, atol=AGREEMENT):
                raise InputError(
                    f"the MuJoCo model does not move as a {plant.name} at q = {q}: "
                    f"{got.tolist()} for {wanted.tolist()}"
                )
