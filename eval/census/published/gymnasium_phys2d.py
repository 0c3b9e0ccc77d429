"""Gymnasium's functional environments in JAX."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Any

from integ_gym.envs import numerics
from integ_gym.envs.ops.ops import join_state, split_state

from ..subjects import Subject
from .interface import Library, jax_step


class GymnasiumPhys2d(Library):
    """Calls ``transition`` of the functional environments, in float32 as JAX has it by default."""

    title = "Gymnasium phys2d"
    package = "gymnasium"
    modules = ("jax", "flax")
    install = "pip install jax flax"

    def subjects(self) -> Iterator[Subject]:
        """`phys2d/Pendulum-v0` and `phys2d/CartPole-v1`."""
        module = import_module("gymnasium.envs.phys2d.pendulum")
        made, params = module.PendulumFunctional(), module.PendulumParams()
        step = _pendulum(made.transition, params)
        yield self.pendulum("phys2d/Pendulum-v0", params, made.max_torque, step)
        module = import_module("gymnasium.envs.phys2d.cartpole")
        params = module.CartPoleParams()
        moment, expected = params.polemass_length, params.masspole * params.length
        wrong = (
            f"its polemass_length is {moment:g}, masspole × length is {expected:g}: its "
            "equations are not those of a cart-pole"
        )
        step = _cart_pole(module.CartPoleFunctional().transition, params)
        note = "" if abs(moment - expected) < 1e-9 else wrong
        yield self.cart_pole("phys2d/CartPole-v1", params, step, width=32, note=note)


def _pendulum(transition: Any, params: Any) -> numerics.OneStep:
    jnp = import_module("jax.numpy")

    def advance(q: Any, v: Any, control: Any) -> tuple[Any, Any]:
        end = transition(jnp.concatenate([q, v]), control, None, params)
        return end[:1], end[1:]

    return jax_step(advance)


def _cart_pole(transition: Any, params: Any) -> numerics.OneStep:
    jnp = import_module("jax.numpy")

    def advance(q: Any, v: Any, control: Any) -> tuple[Any, Any]:
        pushed = params.replace(force_mag=abs(control[0]))
        state = jnp.stack(join_state(q, v))
        return split_state(transition(state, (control[0] > 0.0).astype(int), None, pushed))

    return jax_step(advance)
