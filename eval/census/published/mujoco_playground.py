"""MuJoCo Playground's ports of dm_control's suite."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from importlib import import_module
from typing import Any

from integ_gym.envs import numerics

from ..subjects import Settable, Subject
from .interface import Library, jax_step, max_control, plant_of, statement_of


class MujocoPlayground(Library):
    """Steps the environments as they are configured, from states of our own.

    Warp compiles its kernels for them, which takes a minute once on a machine.
    """

    title = "MuJoCo Playground"
    package = "playground"
    modules = ("mujoco_playground",)
    install = "pip install playground"

    def subjects(self) -> Iterator[Subject]:
        """`PendulumSwingup` and `CartpoleBalance`."""
        for name in ("PendulumSwingup", "CartpoleBalance"):
            with _quiet():
                suite = import_module("mujoco_playground").dm_control_suite
                env = suite.load(name)
                step = _step(env)
            model = env.mj_model
            stated, note = statement_of(model, env.n_substeps), f"MJX, {env.mjx_model.impl.value}"
            yield self.subject(
                name, plant_of(model), stated, max_control(model), Settable(step),
                width=32, note=note,
            )  # fmt: skip


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Without what Warp tells of the devices and of what it compiles."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield


def _step(env: Any) -> numerics.OneStep:
    start = env.reset(import_module("jax").random.key(0))

    def advance(q: Any, v: Any, action: Any) -> tuple[Any, Any]:
        end = env.step(start.replace(data=start.data.replace(qpos=q, qvel=v)), action).data
        return end.qpos, end.qvel

    step = jax_step(advance, float(env.mj_model.actuator_gear[0, 0]))
    still = (0.0,) * len(start.data.qpos)
    step(still, still, 0.0)
    return step
