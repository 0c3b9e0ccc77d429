"""What to expect of a policy before it is trained."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any, ClassVar, Final

import msgspec

from integ_gym.envs import (
    DISCRETIZATION,
    ENGINES,
    INTEGRATORS,
    NATIVE,
    Discretization,
    environment_setup,
    testbed_of,
)
from integ_gym.support import unknown_name

from ...panel import SpecError, map_of
from ...verdict import FAIL_MARGIN
from ..numbers import Quantities
from .fitting import LEVEL, Curve

LAW: Final = "law.json"
"""Made of the atlas's summaries by ``integ-gym atlas --publish``."""

SLIGHT: Final = 0.1
"""Power of the numerics over the motor's up to which the critical limit is near the truth's."""

FINEST: Final = 64
"""Steps per control period down to which a safe one is looked for."""


class Law(msgspec.Struct, frozen=True):
    """What was fitted to an atlas.

    Attributes:
        atlas: its name.
        env_id: of its environment.
        curves: loss by one number, each; that of the number that was chosen first.
        margins: smallest and largest limit of the control over the critical one that it saw.
        critical_ratios: smallest and largest critical limit of a training ground over the truth's
            that it saw, where the task was learned.
        seals: of the runs.
    """

    atlas: str
    env_id: str
    curves: tuple[Curve, ...]
    margins: tuple[float, float]
    critical_ratios: tuple[float, float]
    seals: tuple[str, ...]

    @property
    def curve(self) -> Curve:
        """Of the number that was chosen."""
        return self.curves[0]

    def saw(self, quantities: Quantities) -> bool:
        """Whether it was fitted on this environment, where as much is left to the control."""
        if quantities.env_id != self.env_id:
            return False
        if abs(quantities.power) <= SLIGHT:
            return True
        return _among(quantities.critical_ratio, self.critical_ratios)

    def may_fail(self, quantities: Quantities) -> bool:
        """Whether the interval of a loss ends where a panel's verdict is `fails`."""
        loss = self.curve(quantities)
        return bool(loss + self.curve.half_width(quantities.force, loss) >= FAIL_MARGIN)


@dataclass(frozen=True)
class Prediction:
    """What to expect of a policy trained in a discretization.

    Attributes:
        discretization: where.
        quantities: its numbers and the task's.
        reachable: whether a search over controls reaches the goal's energy there in time.
        loss: share of the success there that is expected to be missing on the truth.
        helped: of it what goes by the help of numerics that pump, which the truth does not give;
            None where the law does not tell.
        half_width: of the interval of the loss.
        level: share of such means over seeds that the interval is expected to hold; single
            policies differ by more.
        fitted_on: smallest and largest limit of the control over the critical one that the law saw.
        seen_ratios: smallest and largest critical limit over the truth's that the law saw.
        safe_dt: coarsest step of this integrator whose interval is known and ends below 0.2, s;
            None where there is none down to a 64th of the control period.
    """

    discretization: Discretization
    quantities: Quantities
    reachable: bool
    loss: float
    helped: float | None
    half_width: float
    fitted_on: tuple[float, float]
    seen_ratios: tuple[float, float]
    safe_dt: float | None
    level: ClassVar[float] = LEVEL

    @property
    def within(self) -> bool:
        """Whether the law was fitted on such limits of the control, here and on the truth."""
        return _among(self.quantities.margin, self.fitted_on) and law().saw(self.quantities)

    @property
    def fitted_env_id(self) -> str:
        """The environment that the law was fitted on."""
        return law().env_id

    @property
    def interval(self) -> tuple[float, float]:
        """Loss that a mean over seeds is expected within, in [-1, 1]."""
        return max(-1.0, self.loss - self.half_width), min(1.0, self.loss + self.half_width)


@cache
def law() -> Law:
    """The law that comes with the package."""
    content = (resources.files(__package__) / LAW).read_bytes()
    return msgspec.json.decode(content, type=Law)


def predict(
    env_id: str = "IntegPendulum-v0",
    *,
    integrator: str,
    dt: float,
    control_period: float | None = None,
    engine: str = NATIVE,
    **environment: Any,
) -> Prediction:
    """What to expect of a policy trained in a discretization, without training it.

    Args:
        env_id: one of integ-gym's environments with a goal at rest.
        integrator: registered name.
        dt: integration step, s.
        control_period: time between two decisions, s; by default the environment's own.
        engine: of the integrator.
        environment: other constructor arguments.

    Raises:
        SpecError: where the task names no goal at rest, the truth cannot reach it, or the engine
            applies a map that none of our integrators applies.
        TypeError, ValueError: for arguments that are not possible.
    """
    period = control_period or testbed_of(env_id, environment).home.control_period
    at = Discretization(integrator, dt, period, engine)
    _check_twin(at)
    known, numbers = law(), Quantities(env_id, environment, _native(at))
    loss = known.curve(numbers)
    return Prediction(
        at,
        numbers,
        numbers.critical_ratio <= numbers.margin,
        loss,
        known.curve.parts(numbers).get("helped"),
        float(known.curve.half_width(numbers.force, loss)),
        known.margins,
        known.critical_ratios,
        _safe_dt(env_id, environment, at),
    )


def doubt(env_id: str, arguments: Mapping[str, Any]) -> str | None:
    """What speaks against training in a discretization, in a sentence; None if nothing is known.

    Args:
        env_id: of the environment.
        arguments: constructor arguments, the discretization among them.
    """
    if env_id != law().env_id or "mixture" in arguments:
        return None
    at = Discretization.of(environment_setup(env_id, arguments))
    own = _native(at)
    if not _is_ours(own.integrator):
        return None
    given = {name: value for name, value in arguments.items() if name not in DISCRETIZATION}
    try:
        known = Quantities(env_id, given, own)
        loss, fails, seen = law().curve(known), law().may_fail(known), law().saw(known)
    except SpecError:
        return None
    if not seen:
        low, high = law().critical_ratios
        return (
            f"what a policy that learns on {at.name} keeps on the truth is not known: the least "
            f"limit of the control there is {known.critical_ratio:.2g} of the truth's, and the law "
            f"of `integ-gym predict` was fitted on {low:.2g} to {high:.2g}"
        )
    if not fails:
        return None
    return (
        f"a policy that learns on {at.name} is expected to lose {loss:.2f} of its success on the "
        f"truth; `integ-gym predict` tells more"
    )


def _among(value: float, ends: tuple[float, float]) -> bool:
    return ends[0] <= value <= ends[1]


def _safe_dt(env_id: str, environment: Mapping[str, Any], at: Discretization) -> float | None:
    for one in _finer(at):
        known = Quantities(env_id, environment, _native(one))
        if law().saw(known) and not law().may_fail(known):
            return one.dt
    return None


def _finer(at: Discretization) -> Iterator[Discretization]:
    """The control period as the step, its half, …"""
    steps = 1
    while steps <= FINEST:
        yield Discretization(at.integrator, at.control_period / steps, at.control_period, at.engine)
        steps *= 2


def _is_ours(applied: str) -> bool:
    """Whether our own engine applies a map: most are called as its integrators are."""
    return applied in INTEGRATORS.names() or ":" in applied


def _check_twin(at: Discretization) -> None:
    """Refuse a map of an engine's that our own engine does not apply.

    Raises:
        SpecError: with the engine's integrators whose maps it applies, and what to do.
        ValueError: for an unknown engine.
    """
    if at.engine == NATIVE or ":" in at.integrator:
        return
    maps: Mapping[str, str] = ENGINES.load(at.engine).maps
    if at.integrator not in maps:
        raise SpecError(unknown_name(f"integrator of {at.engine}", at.integrator, maps))
    if _is_ours(map_of(at)):
        return
    alike = " and ".join(name for name, applied in maps.items() if _is_ours(applied))
    raise SpecError(
        f"nothing is predicted for {at.engine} {at.integrator}: the law was made on our own "
        f"engine, none of whose integrators applies its map, {map_of(at)}; give "
        f"{f'{alike} of {at.engine} or ' if alike else ''}an integrator of the native engine, or "
        "measure it by a panel (integ-gym panel)"
    )


def _native(at: Discretization) -> Discretization:
    """The discretization in which our own engine applies the same map."""
    return Discretization(map_of(at), at.dt, at.control_period)
