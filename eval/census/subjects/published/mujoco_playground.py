"""MuJoCo Playground's ports of dm_control's suite."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from importlib import import_module
from typing import Any, ClassVar

import numpy as np

from integ_gym.envs import Components, numerics
from integ_gym.support import package_version

from ..settable import Settable, single_precision
from ..subject import Subject
from ._mujoco_model import max_control, plant_of, statement_of


class MujocoPlayground:
    """Steps the environments as they are configured, from states of our own.

    Warp compiles its kernels for them, which takes a minute once on a machine.
    """

    title: ClassVar[str] = "MuJoCo Playground"
    modules: ClassVar[tuple[str, ...]] = ("mujoco_playground",)
    install: ClassVar[str] = "pip install playground"

    def subjects(self) -> Iterator[Subject]:
        """`PendulumSwingup` and `CartpoleBalance`."""
        for name in ("PendulumSwingup", "CartpoleBalance"):
            with _quiet():
                suite = import_module("mujoco_playground").dm_control_suite
                env = suite.load(name)
                step = _step(env)
            yield Subject(
                source=self.title,
                name=name,
                version=package_version("playground") or "unknown",
                published=True,
                plant=plant_of(env.mj_model),
                stated=statement_of(env.mj_model, env.dt, env.n_substeps),
                max_control=max_control(env.mj_model),
                access=Settable(step),
                width=32,
                note=f"MJX, {env.mjx_model.impl.value}",
            )


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Without what Warp tells of the devices and of what it compiles."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield


def _step(env: Any) -> numerics.OneStep:
    jax = import_module("jax")
    start = env.reset(jax.random.key(0))
    gear = float(env.mj_model.actuator_gear[0, 0])

    @jax.jit  # type: ignore[untyped-decorator]
    def advance(qpos: Any, qvel: Any, action: Any) -> Any:
        data = start.data.replace(qpos=qpos, qvel=qvel)
        end = env.step(start.replace(data=data), action).data
        return end.qpos, end.qvel

    def advanced(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        action = single_precision(control / gear)
        qpos, qvel = advance(single_precision(*q), single_precision(*v), action)
        return tuple(np.asarray(qpos).tolist()), tuple(np.asarray(qvel).tolist())

    still = (0.0,) * len(start.data.qpos)
    advanced(still, still, 0.0)
    return advanced
