"""A panel with one trained policy on every engine that applies symplectic Euler."""

from __future__ import annotations

from typing import Any

from small_panel import bare_data

from integ_gym.eval.panel.spec import PanelSpec
from integ_gym.eval.panel.units import Unit, units_of

MAPS = [
    "symplectic_euler", "symplectic_euler_implicit_damping", "symplectic_euler_sequential_damping",
]  # fmt: skip


def alike_data() -> dict[str, Any]:
    """Its specification."""
    return bare_data(
        {"integrator": "symplectic_euler", "dt": 0.05},
        {"engine": "installed", "map": MAPS, "dt": 0.05},
        trainer="fleet", seeds=[10], episodes=10, baselines=["handmade"],
        environment={"start": "hanging", "max_torque": 0.9},
        training={
            "total_steps": 300_000, "batch_size": 512, "gae_lambda": 0.9, "learning_rate": 2e-3,
            "learning_rate_end": 0.0,
        },
    )  # fmt: skip


def trained_units(spec: PanelSpec) -> list[Unit]:
    """Training runs of a panel."""
    return [unit for unit in units_of(spec) if unit.home is not None]
