"""gymnax."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Any, ClassVar

from integ_gym.envs import CartPole, Components, Pendulum, numerics
from integ_gym.support import package_version

from ..settable import Settable, single_precision
from ..subject import Statement, Subject


class Gymnax:
    """Calls ``step_env`` from a state of our own, in float32 as JAX has it by default."""

    title: ClassVar[str] = "gymnax"
    modules: ClassVar[tuple[str, ...]] = ("gymnax",)
    install: ClassVar[str] = "pip install 'gymnax<1' six"

    def subjects(self) -> Iterator[Subject]:
        """`Pendulum-v1` and `CartPole-v1`."""
        make = import_module("gymnax").make
        version = package_version("gymnax") or "unknown"
        env, params = make("Pendulum-v1")
        yield Subject(
            source=self.title,
            name="Pendulum-v1",
            version=version,
            published=True,
            plant=Pendulum(mass=params.m, length=params.l, gravity=params.g),
            stated=Statement(params.dt, max_speed=params.max_speed),
            max_control=params.max_torque,
            access=Settable(_pendulum(env, params)),
            width=32,
        )
        env, params = make("CartPole-v1")
        yield Subject(
            source=self.title,
            name="CartPole-v1",
            version=version,
            published=True,
            plant=CartPole(
                cart_mass=params.masscart,
                mass=params.masspole,
                length=params.length,
                gravity=params.gravity,
            ),
            stated=Statement(params.tau, map="explicit_euler", words="Euler"),
            max_control=params.force_mag,
            access=Settable(_cart_pole(env, params)),
            width=32,
            note="force_mag set to the force wanted",
        )


def _pendulum(env: Any, params: Any) -> numerics.OneStep:
    jax = import_module("jax")
    key = jax.random.key(0)
    _, start = env.reset_env(key, params)

    @jax.jit  # type: ignore[untyped-decorator]
    def advance(theta: Any, theta_dot: Any, torque: Any) -> Any:
        state = start.replace(theta=theta, theta_dot=theta_dot)
        end = env.step_env(key, state, torque, params)[1]
        return end.theta, end.theta_dot

    def advanced(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        theta, speed = advance(*single_precision(*q, *v), single_precision(control))
        return (float(theta),), (float(speed),)

    return advanced


def _cart_pole(env: Any, params: Any) -> numerics.OneStep:
    jax = import_module("jax")
    key = jax.random.key(0)
    _, start = env.reset_env(key, params)

    @jax.jit  # type: ignore[untyped-decorator]
    def advance(x: Any, theta: Any, x_dot: Any, theta_dot: Any, action: Any, force: Any) -> Any:
        state = start.replace(x=x, theta=theta, x_dot=x_dot, theta_dot=theta_dot)
        end = env.step_env(key, state, action, params.replace(force_mag=force))[1]
        return end.x, end.theta, end.x_dot, end.theta_dot

    def advanced(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        *state, force = single_precision(*q, *v, abs(control))
        x, theta, x_dot, theta_dot = map(float, advance(*state, int(control > 0.0), force))
        return (x, theta), (x_dot, theta_dot)

    return advanced
