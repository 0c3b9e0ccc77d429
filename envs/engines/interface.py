"""What an engine does: advance a plant through one control period."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple, Protocol

from integ_gym.support.isolated import ISOLATED
from integ_gym.support.optional import check_versions, not_installed

from ..mechanics import PlantSystem
from ..ops.ops import Component, Components, Ops
from ..registries import ENGINES

DIVERGENCE_SPEED = 1e3
"""A velocity component beyond this magnitude (rad/s or m/s) is a divergence."""


class Motion(NamedTuple):
    """A plant's motion over one control period."""

    q: Components
    v: Components
    sampled_q: Components
    """Configuration at the sensor's last sample in this period, if there was one."""
    sampled_v: Components
    work: Component
    """Σ over sub-steps of control times the displacement of the actuated coordinate, J."""
    losses: Components
    """Energy lost per loss component, J: (damping,), or with stops (damping, contact)."""
    clip_loss: Component
    """Energy taken out by the speed limit, J."""
    iterations: Component
    """Most solver iterations of any sub-step."""
    residual: Component
    """Largest scaled solver residual of any sub-step."""
    converged: Component
    finite: Component
    """False once a sub-step has diverged."""
    penetration: Component = 0.0
    """Deepest at the end of any sub-step, m or rad."""
    contact_force: Component = 0.0
    """Of largest magnitude at the end of any sub-step, N or N m."""


Segments = tuple[tuple[Component, int], ...]
"""(control, number of sub-steps) in the order in which they act."""


class Engine(Protocol):
    """Advances a plant; knows nothing of tasks.

    Built from the system, the integrator's name and the sub-step ``dt`` in seconds.
    """

    batched: ClassVar[bool]
    """Whether components may be of any kind, JAX's traced ones included."""
    width: ClassVar[int]
    """Bits of the floats that it computes with outside JAX."""
    reports: bool
    """Whether it tells its solver's iterations and convergence, and its residual if it has one."""
    version: str

    def advance(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        segments: Segments,
        sample_at: Component | None,
    ) -> Motion:
        """Advance through the segments; note the state after sub-step ``sample_at`` (from 1)."""

    def at(self, system: PlantSystem, dt: Component) -> Engine:
        """The same engine for other values of the plant's parameters and the step; if batched."""

    def solver(self) -> dict[str, Any]:
        """`solver_tolerance` and `solver_cap`; None where there is none."""

    def describe(self) -> dict[str, Any]:
        """What the engine is, beyond its name, version and integrator, as plain data."""


def missing_modules(engine: str) -> list[str]:
    """Modules that an engine needs and that are not installed.

    Its extra brings them; of an engine that runs in an environment of its own, what sets that up.
    """
    if engine in ISOLATED:
        return [] if ISOLATED[engine].installed else [engine]
    return not_installed(getattr(ENGINES.load(engine), "modules", ()))


def make_engine(name: str, system: Any, integrator: str, dt: Any) -> Engine:
    """An engine for a system.

    Args:
        name: of the engine, or ``"module:Class"``.
        system: a `PlantSystem`.
        integrator: as the engine calls it.
        dt: integration step, s.

    Raises:
        ValueError: for an unknown engine or integrator, or a package of the engine that is older
            than its extra asks for; see `check_versions`.
    """
    kind = ENGINES.load(name)
    check_versions(name)
    engine: Engine = kind(system, integrator, dt)
    return engine


def integrators_of(engine: str) -> tuple[str, ...]:
    """The integrators of an engine, as it calls them; ours without the exact one."""
    return tuple(ENGINES.load(engine).maps)
