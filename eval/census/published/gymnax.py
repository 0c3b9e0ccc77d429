"""gymnax."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Any

from integ_gym.envs import numerics

from ..subjects import Subject
from .interface import Library, jax_step


class Gymnax(Library):
    """Calls ``step_env`` from a state of our own, in float32 as JAX has it by default."""

    title = "gymnax"
    package = "gymnax"
    modules = ("gymnax",)
    install = "pip install 'gymnax<1' six"

    def subjects(self) -> Iterator[Subject]:
        """`Pendulum-v1` and `CartPole-v1`."""
        make = import_module("gymnax").make
        env, params = make("Pendulum-v1")
        step = _step(env, params, ("theta",))
        yield self.pendulum("Pendulum-v1", params, params.max_torque, step)
        env, params = make("CartPole-v1")
        yield self.cart_pole(
            "CartPole-v1", params, _step(env, params, ("x", "theta")), "Euler", width=32,
            note="force_mag set to the force wanted",
        )  # fmt: skip


def _step(env: Any, params: Any, names: tuple[str, ...]) -> numerics.OneStep:
    """One control period; ``names`` are those of the coordinates."""
    key = import_module("jax").random.key(0)
    _, start = env.reset_env(key, params)
    speeds = tuple(f"{name}_dot" for name in names)

    def advance(q: Any, v: Any, control: Any) -> tuple[Any, Any]:
        state = start.replace(**dict(zip((*names, *speeds), (*q, *v), strict=True)))
        action, given = control, params
        if hasattr(params, "force_mag"):
            action, given = (
                (control[0] > 0.0).astype(int),
                params.replace(force_mag=abs(control[0])),
            )
        end = env.step_env(key, state, action, given)[1]
        return [getattr(end, name) for name in names], [getattr(end, name) for name in speeds]

    return jax_step(advance)
