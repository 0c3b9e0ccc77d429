"""Whether a simulator's model is the plant: its mass matrix and the force of gravity."""

from __future__ import annotations

from typing import ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from ...arithmetic import SCALAR, Components
from ...mechanics import Mechanism
from ...plants import Plant

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

    def inertia(self, q: Components) -> Array:
        """The simulator's mass matrix, (dof, dof), kg, kg m, kg m^2."""

    def gravity(self, q: Components) -> Array:
        """The simulator's generalized force of gravity, (dof,), N or N m."""


class Floored(Protocol):
    """An engine that takes no moment of inertia below some least one."""

    name: ClassVar[str]
    width: ClassVar[int]
    least_inertia: ClassVar[float]


def check_weight(model: Floored, mechanism: Mechanism) -> None:
    """Check that the least moment of inertia that an engine takes makes no difference.

    Raises:
        ValueError: if it does.
    """
    least = model.least_inertia
    for link in mechanism.links:
        about_joint = link.inertia + link.mass * link.centre**2
        tolerated = TOLERANCE[model.width] * about_joint
        if link.joint == "hinge" and max(link.inertia, tolerated) < least:
            raise ValueError(
                f"engine {model.name!r} takes no body's moment of inertia below {least:g} kg m^2, "
                f"which the plant's {about_joint:g} kg m^2 about {link.coordinate!r} is too small "
                f"for; use a larger mass or length, or an engine without this limit, such as "
                "'native', 'drake' or 'pinocchio'"
            )


def check_dampers(mechanism: Mechanism, plant: Plant) -> None:
    """Check that the plant's damping is that of dampers at the mechanism's joints.

    Raises:
        ValueError: if it is not.
    """
    for probe in PROBES:
        q = v = probe[-len(plant.coordinates) :]
        expected = sum(link.damping * x * x for link, x in zip(mechanism.links, v, strict=True))
        power = plant.dissipation(SCALAR, q, v)
        if not np.isclose(power, expected, rtol=1e-12, atol=0.0):
            raise ValueError(
                f"plant {plant.name!r} loses {power:g} W to damping at q = v = {v}, where the "
                f"dampers of its `mechanism` take {expected:g} W; give its links the same damping"
            )


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
        for what, got, wanted in (
            ("mass matrix", model.inertia(q), expected),
            ("gravity force", model.gravity(q), weight),
        ):
            scale = max(float(np.abs(wanted).max()), 1e-30)
            if not np.allclose(got, wanted, rtol=0.0, atol=TOLERANCE[model.width] * scale):
                raise ValueError(
                    f"engine {model.name!r} {model.version} has another {what} than the plant at "
                    f"q = {q}: {np.asarray(got).tolist()} for {wanted.tolist()}; this version "
                    "of the engine cannot be compared"
                )
