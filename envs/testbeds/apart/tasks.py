"""dm_control's suite and Isaac Lab's own cart-pole as testbeds."""

from __future__ import annotations

from pathlib import Path

from integ_gym.support.packages.apart.environments import APART

from .remote import RemoteTestbed


class DmControlTask(RemoteTestbed):
    """A task of dm_control's suite, ``"dm_control:cartpole.swingup"``, stepped by its own MuJoCo.

    dm_control counts the steps of a control period when an environment is made, and never again:
    each is made with the step that was asked for. Arguments are those of the suite's task.
    """

    apart = APART["dm_control"]
    served = Path(__file__).with_name("served_dm_control.py")
    choices = ("Euler", "RK4", "implicit", "implicitfast")


class IsaaclabTask(RemoteTestbed):
    """Isaac Lab's own cart-pole, ``"isaaclab:Isaac-Cartpole-Direct"``, on Newton and the CPU.

    Its integrators are those of Newton's MuJoCo solver, by Isaac Lab's names, and ``dt`` is
    Newton's own step. Arguments are ``newton_substeps``, how many of them are taken in each of
    Isaac Lab's, and ``cart_damping``, N s/m, of the cart's actuator.
    """

    apart = APART["isaaclab"]
    served = Path(__file__).with_name("served_isaaclab.py")
    choices = ("euler", "implicitfast", "rk4")
