"""dm_control's suite as a testbed."""

from __future__ import annotations

from pathlib import Path

from integ_gym.support import APART

from .remote import RemoteTestbed


class DmControlTask(RemoteTestbed):
    """A task of dm_control's suite, ``"dm_control:cartpole.swingup"``, stepped by its own MuJoCo.

    dm_control counts the steps of a control period when an environment is made, and never again:
    each is made with the step that was asked for. Arguments are those of the suite's task.
    """

    apart = APART["dm_control"]
    served = Path(__file__).with_name("served_dm_control.py")
    choices = ("Euler", "RK4", "implicit", "implicitfast")
