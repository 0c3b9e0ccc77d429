"""dm_control's suite."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module

from ..subjects import Settable, Subject
from .interface import (
    Library,
    control_step,
    max_control,
    plant_of,
    statement_of,
)

SUBSTEPS = 1
"""Physics steps in one control period: the suite's environments leave it at dm_control's own."""


class DmControl(Library):
    """The suite's models, compiled and stepped by the installed MuJoCo.

    The environments themselves are not made: dm_control 1.0.50 does not load its `Physics` with
    MuJoCo 4.0. What one control period does is in the model and the number of steps.
    """

    title = "dm_control"
    package = "dm_control"
    modules = ("dm_control", "mujoco")
    install = "pip install dm_control"

    def subjects(self) -> Iterator[Subject]:
        """Domains `pendulum` and `cartpole`."""
        mujoco = import_module("mujoco")
        for domain in ("pendulum", "cartpole"):
            suite = import_module(f"dm_control.suite.{domain}")
            model = mujoco.MjModel.from_xml_string(*suite.get_model_and_assets())
            yield self.subject(
                domain, plant_of(model), statement_of(model, SUBSTEPS), max_control(model),
                Settable(control_step(model, SUBSTEPS)),
                note=f"the suite's model, stepped by mujoco {mujoco.__version__} itself",
            )  # fmt: skip
