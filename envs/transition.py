"""One control period of an environment, as a pure function over components.

The single, the vector and the functional environment all advance through :func:`transition`.
"""

from __future__ import annotations

from typing import NamedTuple

from integ_gym.envs.engines.interface import DIVERGENCE_SPEED, Motion, Segments
from integ_gym.envs.ops import Component, Components, Ops
from integ_gym.envs.settings import Setup
from integ_gym.envs.tasks.interface import Command

OK, NOT_CONVERGED, DIVERGED = 0, 1, 2
STATUS_NAMES = ("ok", "not_converged", "diverged")

AWAY = -1.0
"""`goal_since` while the state is not at the goal."""


class EnvState(NamedTuple):
    """All that evolves within an episode."""

    q: Components
    v: Components
    energy: Component
    """Energy of (q, v), J."""
    commands: tuple[Component, ...]
    """Past controls asked for, newest first."""
    fallbacks: tuple[Component, ...]
    """Whether each of them came from the fallback."""
    sensed_q: Components
    """Configuration at the sensor's last sample."""
    sensed_v: Components
    sensed_time: Component
    """When that sample was taken, s."""
    steps: Component
    """Decisions so far."""
    goal_since: Component
    """Since when the state has been at the goal without a break, s, or -1."""


class Outcome(NamedTuple):
    """What one control period brought; energies in J over the period."""

    reward: Component
    terminated: Component
    truncated: Component
    success: Component
    sampled: Component
    """Whether the sensor took a new sample."""
    work: Component
    dissipated: Component
    clip_loss: Component
    residual_energy: Component
    control: Component
    """Control in force at the end of the period."""
    commanded: Component
    """Control asked for by this decision, after saturation and fallback."""
    saturated: Component
    fallback_used: Component
    iterations: Component
    solver_residual: Component
    status: Component


def initial_state(ops: Ops, setup: Setup, q: Components, v: Components) -> EnvState:
    """Episode state at time 0; no command is under way yet."""
    zero = 0.0 * q[0]
    memory = setup.timing.memory
    at_goal = setup.task.at_goal(ops, q, v)
    return EnvState(
        q=q,
        v=v,
        energy=setup.system.energy(ops, q, v),
        commands=(zero,) * memory,
        fallbacks=(zero == 0.0,) * memory,
        sensed_q=q,
        sensed_v=v,
        sensed_time=zero,
        steps=0,
        goal_since=ops.where(at_goal, 0.0, AWAY),
    )


def transition(
    ops: Ops, setup: Setup, state: EnvState, action: Component
) -> tuple[EnvState, Outcome]:
    """Advance one control period under ``action`` (torque, force or action index)."""
    timing = setup.timing
    command = setup.task.command(ops, action)
    control, fell_back = _with_fallback(ops, setup, state, command)
    commands, fallbacks = (control, *state.commands), (fell_back, *state.fallbacks)
    segments, fallback_used = _segments(timing.delay, timing.substeps, commands, fallbacks)
    sample_at = _sample_at(setup, state.steps)
    motion = _advance(ops, setup, state, segments, sample_at)
    return _settle(
        ops, setup, state, motion, command.saturated, commands, fallbacks, segments,
        fallback_used, sample_at,
    )  # fmt: skip


def _with_fallback(
    ops: Ops, setup: Setup, state: EnvState, command: Command
) -> tuple[Component, Component]:
    held = state.commands[0] if setup.settings.fallback == "hold" else 0.0
    return ops.where(command.valid, command.control, held), command.valid == False  # noqa: E712


def _segments(
    delay: tuple[int, int],
    substeps: int,
    commands: tuple[Component, ...],
    fallbacks: tuple[Component, ...],
) -> tuple[Segments, Component]:
    """The controls that act in this period, oldest first, and whether one is the fallback's."""
    periods, rest = delay
    recent = (commands[periods], substeps - rest)
    if not rest:
        return (recent,), fallbacks[periods]
    used = fallbacks[periods + 1] | fallbacks[periods]
    return ((commands[periods + 1], rest), recent), used


def _sample_at(setup: Setup, steps: Component) -> Component | None:
    """Sub-step of this period (from 1) at which the sensor samples last; 0 or below: none."""
    timing = setup.timing
    if timing.sensor is None:
        return None
    end = (steps + 1) * timing.substeps
    return end - end % timing.sensor - steps * timing.substeps


def _advance(
    ops: Ops, setup: Setup, state: EnvState, segments: Segments, sample_at: Component | None
) -> Motion:
    try:
        return setup.engine.advance(ops, state.q, state.v, segments, sample_at)
    except ArithmeticError:
        q, v = state.q, state.v
        return Motion(q, v, q, v, 0.0, (0.0,), 0.0, 0, 0.0, False, False)


def _settle(
    ops, setup, state, motion, saturated, commands, fallbacks, segments, fallback_used, sample_at
):  # type: ignore[no-untyped-def]  # fmt: skip
    """New state and outcome; a diverged motion leaves the last good state and a zero ledger."""
    timing, task = setup.timing, setup.task
    ok = motion.finite

    def kept(new: Components, old: Components) -> Components:
        return tuple([ops.where(ok, a, b) for a, b in zip(new, old, strict=True)])

    def booked(amount: Component) -> Component:
        return ops.where(ok, amount, 0.0)

    q, v = kept(motion.q, state.q), kept(motion.v, state.v)
    energy = setup.system.energy(ops, q, v)
    work, dissipated = booked(motion.work), booked(motion.losses[0])
    clip_loss = booked(motion.clip_loss)
    steps = state.steps + 1
    time = steps * timing.control_period
    at_goal = task.at_goal(ops, q, v)
    since = ops.where(at_goal, ops.where(state.goal_since >= 0.0, state.goal_since, time), AWAY)
    failed = task.terminated(ops, q, v) & ok
    truncated = (steps >= timing.horizon) & (ok == ok)
    terminated = failed | (ok == False)  # noqa: E712
    stayed = (since >= 0.0) & (time - since >= task.goal_stay * (1.0 - 1e-9))
    sampled = True if sample_at is None else sample_at > 0
    fresh = sampled & ok
    new_state = EnvState(
        q,
        v,
        energy,
        commands[: timing.memory],
        fallbacks[: timing.memory],
        tuple([ops.where(fresh, a, b) for a, b in zip(motion.sampled_q, state.sensed_q, strict=True)]),
        tuple([ops.where(fresh, a, b) for a, b in zip(motion.sampled_v, state.sensed_v, strict=True)]),
        ops.where(fresh, _sample_time(timing, state.steps, sample_at), state.sensed_time),
        steps,
        since,
    )
    outcome = Outcome(
        reward=ops.where(
            ok,
            task.reward(
                ops, state.q, state.v, _mean_square(segments, timing.substeps), failed,
                timing.control_period,
            ),
            task.worst_return(
                ops, timing.horizon - state.steps, timing.control_period, top_speed(setup)
            ),
        ),
        terminated=terminated,
        truncated=truncated,
        success=truncated & stayed & (terminated == False),  # noqa: E712
        sampled=fresh,
        work=work,
        dissipated=dissipated,
        clip_loss=clip_loss,
        residual_energy=energy - state.energy - work + dissipated + clip_loss,
        control=segments[-1][0],
        commanded=commands[0],
        saturated=saturated,
        fallback_used=fallback_used,
        iterations=motion.iterations,
        solver_residual=booked(motion.residual),
        status=ops.where(ok, ops.where(motion.converged, OK, NOT_CONVERGED), DIVERGED),
    )  # fmt: skip
    return new_state, outcome


def _sample_time(timing, steps, sample_at):  # type: ignore[no-untyped-def]
    if sample_at is None:
        return (steps + 1) * timing.control_period
    return (steps * timing.substeps + sample_at) * timing.dt


def _mean_square(segments: Segments, substeps: int) -> Component:
    """Time average of the squared control over the period."""
    if len(segments) == 1:
        return segments[0][0] * segments[0][0]
    return sum(count * (control * control) for control, count in segments) / substeps


def top_speed(setup: Setup) -> Component:
    """Largest speed a motion can have without diverging, rad/s or m/s."""
    return DIVERGENCE_SPEED if setup.system.max_speed is None else setup.system.max_speed
