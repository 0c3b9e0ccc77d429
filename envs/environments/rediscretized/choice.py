"""What may be chosen for a MuJoCo task: checked against what its model can do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from integ_gym.support import (
    check_values,
    finite_number,
    load,
    parameter,
    positive,
    text,
    unknown_name,
)

from ...episode import check_divides


@dataclass(frozen=True)
class Choice:
    """The arguments of :func:`integ_gym.rediscretize`; None leaves the task as it is.

    Raises:
        ValueError: for a value of another kind or range, with what was expected.
    """

    integrator: str | None = parameter(None, "", "MuJoCo's name", text)
    dt: float | None = parameter(None, "s", "timestep", positive)
    success_return: float | None = parameter(None, "", "return of a success", finite_number)

    def __post_init__(self) -> None:
        check_values(Choice, {name: x for name, x in vars(self).items() if x is not None})

    def step_of(self, model: Any, period: float) -> float:
        """The timestep, s.

        Raises:
            ValueError: if the control period ``period``, s, is no whole multiple of it.
        """
        step = float(model.opt.timestep) if self.dt is None else float(self.dt)
        check_divides("dt", step, "the control period", period)
        return step

    def integrator_of(self, model: Any) -> str:
        """MuJoCo's name of the integrator.

        Raises:
            ValueError: for one that MuJoCo lacks, with those it has.
        """
        known = integrator_numbers()
        if self.integrator is None:
            return next(own for own, number in known.items() if number == model.opt.integrator)
        if self.integrator not in known:
            raise ValueError(unknown_name("integrator of MuJoCo", self.integrator, known))
        return self.integrator


def integrator_numbers() -> dict[str, int]:
    """Integrators of the installed MuJoCo by the names that its model files use."""
    members = load("mujoco", "mujoco").mjtIntegrator.__members__.values()
    capitals = {"euler": "Euler", "rk4": "RK4"}
    names = [member.name.removeprefix("mjINT_").lower() for member in members]
    return {capitals.get(n, n): int(m) for n, m in zip(names, members, strict=True)}
