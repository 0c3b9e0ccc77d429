"""Isaac Lab's own cart-pole."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from integ_gym.envs import numerics
from integ_gym.envs.ops.ops import Components
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.testbeds.making import find_testbed, make_checked
from integ_gym.support.isolated import APART

from ..subjects import Settable, Statement, Subject
from .interface import Library

TASK = "Isaac-Cartpole-Direct"
EXPLICIT = "euler"
"""Under which the damping of the cart's actuator is not taken as in the task's own integrator."""

MASS, CENTRE, INERTIA = 1.0, 0.47, (0.06**2 + 1.0) / 12.0
"""Of the pole, kg, m, kg m^2: a box; the cart is as heavy."""

DAMPING = 10.0
"""Of the cart's actuator, N s/m."""

FORCE = 100.0
"""Of an action of 1, N."""


class Isaaclab(Library):
    """Isaac Lab's cart-pole on Newton, as it comes, and with its solver's `euler`.

    Its process sets any state. The pole tips to the other side than the plant's.
    """

    title = "Isaac Lab"
    package = "isaaclab"
    modules = ()
    apart = APART["isaaclab"]
    install = apart.command

    def subjects(self) -> Iterator[Subject]:
        """The task on two integrators."""
        home = find_testbed(f"isaaclab:{TASK}", {}).home
        for name, integrator in ((TASK, home.integrator), (f"{TASK}, {EXPLICIT}", EXPLICIT)):
            period = home.dt if home.control_period is None else home.control_period
            stated = Statement(period, round(period / home.dt), words=integrator)
            yield self.subject(
                name, plant_of(DAMPING), stated, FORCE,
                Settable(decision(integrator, home.dt)), width=32,
                note="the damping of its actuator is told to MuJoCo as an actuator's",
            )  # fmt: skip


def plant_of(damping: float) -> CartPole:
    """The cart-pole with its pole as the point mass on a rod that moves alike.

    Args:
        damping: of the cart, N s/m.
    """
    length = (CENTRE**2 + INERTIA / MASS) / CENTRE
    mass = MASS * CENTRE / length
    return CartPole(
        cart_mass=2.0 * MASS - mass, mass=mass, length=length, gravity=9.81,
        mass_distribution="point", cart_damping=damping,
    )  # fmt: skip


def decision(integrator: str, dt: float, **arguments: Any) -> numerics.OneStep:
    """One decision of the task, from any state.

    Args:
        integrator: Isaac Lab's name.
        dt: step, s.
        arguments: of the testbed.
    """
    testbed = find_testbed(f"isaaclab:{TASK}", arguments)
    environments = make_checked(testbed, replace(testbed.home, integrator=integrator, dt=dt), 1)
    worker = environments.unwrapped.envs[0].unwrapped.worker  # type: ignore[attr-defined]

    def decided(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        worker.call("put", lane=0, position=[q[0], -q[1]], velocity=[v[0], -v[1]])
        told, *_ = worker.call("step", lane=0, action=[control / FORCE])
        return (told[0], -told[1]), (told[2], -told[3])

    return decided
