"""Whether a simulator's model is the plant: its mass matrix and the force of gravity."""

from __future__ import annotations

from typing import ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from ...arithmetic.ops import SCALAR, Components
from ...mechanics.mechanism import Mechanism
from ...plants.interface import Plant

Array = npt.NDArray[np.float64]

TOLERANCE = {64: 1e-9, 32: 1e-5}
"""Largest relative error of a mass matrix or gravity force, by the width of the engine's floats."""

PROBES = ((0.3, -0.7), (-1.1, 2.2), (0.6, 1.4))
"""Configurations at which an engine is compared with the plant."""


class Model(Protocol):
    """An engine with a model of its own of the plant."""

    name: ClassVar[str]
    width: ClassVar[int]
    version: str

    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """The simulator's mass matrix, (dof, dof), kg, kg m, kg m^2, and its force of gravity.

        That is a generalized force, (dof,), N or N m.
        """


def mechanism_of(engine: str, plant: Plant) -> Mechanism:
    """The plant's links.

    Raises:
        ValueError: if it has none, and if their dampers do not take what the plant's damping takes.
    """
    mechanism: Mechanism | None = getattr(plant, "mechanism", None)
    if mechanism is None:
        raise ValueError(
            f"engine {engine!r} moves rigid links, and the plant {plant.name!r} has none: it gives "
            "no `mechanism`; use engine 'native' or 'casadi'"
        )
    for probe in PROBES:
        q = v = probe[-len(plant.coordinates) :]
        expected = sum(link.damping * x * x for link, x in zip(mechanism.links, v, strict=True))
        power = plant.dissipation(SCALAR, q, v)
        if not np.isclose(power, expected, rtol=1e-12, atol=0.0):
            raise ValueError(
                f"plant {plant.name!r} loses {power:g} W to damping at q = v = {v}, where the "
                f"dampers of its `mechanism` take {expected:g} W; give its links the same damping"
            )
    return mechanism


def check_agreement(model: Model, plant: Plant) -> None:
    """Compare mass matrix and gravity force with the plant's.

    Raises:
        ValueError: if they differ.
    """
    for probe in PROBES:
        q = probe[-len(plant.coordinates) :]
        expected = np.array(plant.mass_matrix(SCALAR, q), dtype=np.float64)
        still = (0.0,) * len(q)
        weight = expected @ np.array(plant.acceleration(SCALAR, q, still, still))
        mass, gravity = model.at_rest(q)
        for what, got, wanted in (
            ("mass matrix", mass, expected),
            ("gravity force", gravity, weight),
        ):
            scale = max(float(np.abs(wanted).max()), 1e-30)
            if not np.allclose(got, wanted, rtol=0.0, atol=TOLERANCE[model.width] * scale):
                raise ValueError(
                    f"engine {model.name!r} {model.version} has another {what} than the plant at "
                    f"q = {q}: {np.asarray(got).tolist()} for {wanted.tolist()}; this version "
                    "of the engine cannot be compared"
                )
