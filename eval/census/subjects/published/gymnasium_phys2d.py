"""Gymnasium's functional environments in JAX."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Any, ClassVar

import gymnasium
import numpy as np

from integ_gym.envs import CartPole, Components, Pendulum, join_state, numerics, split_state

from ..settable import Settable, single_precision
from ..subject import Statement, Subject


class GymnasiumPhys2d:
    """Calls ``transition`` of the functional environments, in float32 as JAX has it by default."""

    title: ClassVar[str] = "Gymnasium phys2d"
    modules: ClassVar[tuple[str, ...]] = ("jax", "flax")
    install: ClassVar[str] = "pip install jax flax"

    def subjects(self) -> Iterator[Subject]:
        """`phys2d/Pendulum-v0` and `phys2d/CartPole-v1`."""
        module = import_module("gymnasium.envs.phys2d.pendulum")
        made, params = module.PendulumFunctional(), module.PendulumParams()
        yield Subject(
            source=self.title,
            name="phys2d/Pendulum-v0",
            version=gymnasium.__version__,
            published=True,
            plant=Pendulum(mass=params.m, length=params.l, gravity=params.g),
            stated=Statement(params.dt, max_speed=params.max_speed),
            max_control=made.max_torque,
            access=Settable(_pendulum(made.transition, params)),
            width=32,
        )
        module = import_module("gymnasium.envs.phys2d.cartpole")
        params = module.CartPoleParams()
        moment, expected = params.polemass_length, params.masspole * params.length
        yield Subject(
            source=self.title,
            name="phys2d/CartPole-v1",
            version=gymnasium.__version__,
            published=True,
            plant=CartPole(
                cart_mass=params.masscart,
                mass=params.masspole,
                length=params.length,
                gravity=params.gravity,
            ),
            stated=Statement(params.tau),
            max_control=params.force_mag,
            access=Settable(_cart_pole(module.CartPoleFunctional().transition, params)),
            width=32,
            note=""
            if abs(moment - expected) < 1e-9
            else f"its polemass_length is {moment:g}, masspole × length is {expected:g}: its "
            "equations are not those of a cart-pole",
        )


def _pendulum(transition: Any, params: Any) -> numerics.OneStep:
    advance = import_module("jax").jit(lambda state, u: transition(state, u, None, params))

    def advanced(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        end = advance(single_precision(*q, *v), single_precision(control))
        return split_state(tuple(np.asarray(end).tolist()))

    return advanced


def _cart_pole(transition: Any, params: Any) -> numerics.OneStep:
    def pushed(state: Any, action: Any, force: Any) -> Any:
        return transition(state, action, None, params.replace(force_mag=force))

    advance = import_module("jax").jit(pushed)

    def advanced(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        state, force = single_precision(*join_state(q, v)), single_precision(abs(control))[0]
        end = advance(state, int(control > 0.0), force)
        return split_state(tuple(np.asarray(end).tolist()))

    return advanced
