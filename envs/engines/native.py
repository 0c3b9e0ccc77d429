"""The native engine: integ-gym's own integrators, for scalars, arrays and JAX."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from typing import Any, ClassVar

from integ_gym.envs.engines.interface import DIVERGENCE_SPEED, Motion, Segments
from integ_gym.envs.integrators import INTEGRATORS
from integ_gym.envs.ops import FLOAT32_MAX, Component, Components, Ops
from integ_gym.envs.system import PlantSystem


class NativeEngine:
    """Applies one of the integrators to the plant's equations of motion.

    Args:
        system: plant with its speed limit.
        integrator: a registered name or ``"module:Class"``.
        dt: integration step, s.

    Raises:
        ValueError: for an unknown integrator.
    """

    batched: ClassVar[bool] = True

    def __init__(self, system: PlantSystem, integrator: str, dt: Component) -> None:
        self.system = system
        self.integrator = INTEGRATORS.load(integrator)()
        self.dt = dt
        self.version = _package_version()

    def solver(self) -> dict[str, Any]:
        """Tolerance and iteration cap of the integrator's solver."""
        names = ("solver_tolerance", "solver_cap")
        return {name: getattr(self.integrator, name, None) for name in names}

    def advance(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        segments: Segments,
        sample_at: Component | None,
    ) -> Motion:
        """Advance through the segments of constant control."""
        motion = Motion(q, v, q, v, 0.0, self.system.no_losses, 0.0, 0, 0.0, True, True)
        done = 0
        for control, count in segments:
            motion = ops.repeat(count, self._sub_step(ops, control, sample_at, done), motion)
            done += count
        if sample_at is None:
            return motion._replace(sampled_q=motion.q, sampled_v=motion.v)
        return motion

    def _sub_step(self, ops: Ops, control: Component, sample_at: Component | None, done: int):  # type: ignore[no-untyped-def]
        system, dt, step = self.system, self.dt, self.integrator.step
        actuated, stops = system.plant.actuated, system.stops

        def advance(index: Component, motion: Motion) -> Motion:
            (
                q0, v0, sampled_q, sampled_v, work, losses, clipped, most, worst, converged, ok,
                depth, push,
            ) = motion  # fmt: skip
            q, raw, losses, iterations, residual, solved = step(
                ops, system, q0, v0, losses, control, dt
            )
            v = raw
            if system.max_speed is not None:
                v = system.limit(ops, raw)
                clipped = clipped + (system.energy(ops, q, raw) - system.energy(ops, q, v))
            if stops is not None:
                contact = stops.contact(ops, q, v)
                depth = ops.maximum(depth, contact.penetration)
                push = ops.where(abs(contact.force) > abs(push), contact.force, push)
            if sample_at is not None:
                now = sample_at == done + index + 1
                sampled_q = tuple([ops.where(now, a, b) for a, b in zip(q, sampled_q, strict=True)])
                sampled_v = tuple([ops.where(now, a, b) for a, b in zip(v, sampled_v, strict=True)])
            return Motion(
                q,
                v,
                sampled_q,
                sampled_v,
                work + control * (q[actuated] - q0[actuated]),
                losses,
                clipped,
                ops.maximum(most, iterations),
                ops.maximum(worst, residual),
                converged & solved,
                ok & within_bounds(q, raw),
                depth,
                push,
            )

        return advance


def within_bounds(q: Components, v: Components) -> Component:
    """Whether a state is finite, representable in float32 and below the divergence speed."""
    ok = abs(v[0]) <= DIVERGENCE_SPEED
    for x in v[1:]:
        ok = ok & (abs(x) <= DIVERGENCE_SPEED)
    for x in q:
        ok = ok & (abs(x) <= FLOAT32_MAX)
    return ok


def _package_version() -> str:
    try:
        return version("integ-gym")
    except PackageNotFoundError:
        return "unknown"
