"""dm_control's suite."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import ClassVar

from integ_gym.support import package_version

from ..settable import Settable
from ..subject import Subject
from ._mujoco_model import control_step, max_control, plant_of, statement_of

SUBSTEPS = 1
"""Physics steps in one control period: the suite's environments leave it at dm_control's own."""


class DmControl:
    """The suite's models, compiled and stepped by the installed MuJoCo.

    The environments themselves are not made: dm_control 1.0.50 does not load its `Physics` with
    MuJoCo 4.0. What one control period does is in the model and the number of steps.
    """

    title: ClassVar[str] = "dm_control"
    modules: ClassVar[tuple[str, ...]] = ("dm_control", "mujoco")
    install: ClassVar[str] = "pip install dm_control"

    def subjects(self) -> Iterator[Subject]:
        """Domains `pendulum` and `cartpole`."""
        mujoco = import_module("mujoco")
        for domain in ("pendulum", "cartpole"):
            suite = import_module(f"dm_control.suite.{domain}")
            model = mujoco.MjModel.from_xml_string(*suite.get_model_and_assets())
            yield Subject(
                source=self.title,
                name=domain,
                version=package_version("dm_control") or "unknown",
                published=True,
                plant=plant_of(model),
                stated=statement_of(model, SUBSTEPS * model.opt.timestep, SUBSTEPS),
                max_control=max_control(model),
                access=Settable(control_step(model, SUBSTEPS)),
                note=f"the suite's model, stepped by mujoco {mujoco.__version__} itself",
            )
