"""The report's part on engines: do policies do the same where the same map is applied."""

from __future__ import annotations

from dataclasses import dataclass

from integ_gym.eval.formatting import finite
from integ_gym.eval.report_data.panel import Panel
from integ_gym.eval.report_data.parts import Json


@dataclass(frozen=True)
class EngineLine:
    """One cell on a foreign engine, beside the native cell of the same map.

    Attributes:
        engine: name.
        integrator: as the engine calls it.
        map: the one-step map that it applies.
        dt: integration step, s.
        twin: name of the native cell of that map and step; empty without one.
        success: over all rows.
        twin_success: the same in the twin.
        differing: episodes that ended otherwise there.
        episodes: in the cell.
        largest: largest difference of a row's success.
    """

    engine: str
    integrator: str
    map: str
    dt: float | None
    twin: str
    success: float | None
    twin_success: float | None
    differing: int | None
    episodes: int | None
    largest: float | None


def engine_lines(panel: Panel) -> tuple[EngineLine, ...]:
    """Cells on foreign engines, by map, then by engine, coarse steps first."""
    lines = (_line(raw) for raw in panel.items("engine_agreement"))
    return tuple(sorted(lines, key=lambda one: (one.map, one.engine, -(one.dt or 0.0))))


def _line(raw: Json) -> EngineLine:
    differing, episodes = finite(raw.get("differing")), finite(raw.get("episodes"))
    return EngineLine(
        engine=str(raw.get("engine")),
        integrator=str(raw.get("integrator")),
        map=str(raw.get("map")),
        dt=finite(raw.get("dt")),
        twin=str(raw.get("twin") or ""),
        success=finite(raw.get("success")),
        twin_success=finite(raw.get("twin_success")),
        differing=None if differing is None else int(differing),
        episodes=None if episodes is None else int(episodes),
        largest=finite(raw.get("largest")),
    )
