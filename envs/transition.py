"""One control period of an environment, as a pure function over components.

The single, the vector and the functional environment all advance through :func:`transition`.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial, reduce
from operator import add
from typing import Any, NamedTuple

from .engines.stepping import DIVERGENCE_SPEED, Held, Segments
from .ops.ops import Component, Components, Ops, map_leaves, select, split_state
from .plants.contact import Touch
from .plants.system import Motion
from .settings import Setup, Timing
from .tasks.interface import Command

OK, NOT_CONVERGED, DIVERGED, NOT_REPORTED = 0, 1, 2, -1
STATUS_NAMES: tuple[str, ...] = ("ok", "not_converged", "diverged", "not_reported")
"""By code: what is not reported is the last, and the least of the codes; a larger one is worse."""

AWAY = -1.0
"""`goal_since` while the state is not at the goal."""

NEVER = 2.0**60
"""Integration steps until a command arrives that is lost; so many that no episode has them."""


class EnvState(NamedTuple):
    """All that evolves within an episode."""

    q: Components
    v: Components
    energy: Component
    """Energy of (q, v), J."""
    commands: tuple[Components, ...]
    """Past controls asked for, newest first; where arrivals are drawn, then those in force."""
    fallbacks: tuple[Component, ...]
    """Whether each of them came from the fallback."""
    arrivals: tuple[Component, ...]
    """Integration steps from now until each arrives, but for the one in force, where drawn."""
    sensed_q: Components
    """Configuration at the last sample that has arrived."""
    sensed_v: Components
    sensed_time: Component
    """When that sample was taken, s."""
    late: tuple[tuple[Components, Components, Component], ...]
    """Under an observation latency: what will be shown after the next decisions, newest first, each
    as configuration, velocities and time, s."""
    steps: Component
    """Decisions so far."""
    goal_since: Component
    """Since when the state has been at the goal without a break, s, or -1."""


class Outcome(NamedTuple):
    """What one control period brought, by default nothing; energies in J over the period."""

    reward: Component = 0.0
    terminated: Component = False
    truncated: Component = False
    success: Component = False
    sampled: Component = True
    """Whether a new sample is shown."""
    work: Component = 0.0
    dissipated: Component = 0.0
    contact_loss: Component = 0.0
    """Taken out by contact: by damping normal to what is touched, and by friction on it."""
    clip_loss: Component = 0.0
    residual_energy: Component = 0.0
    controls: Components = (0.0,)
    """Those in force at the end of the period."""
    efforts: Components = ()
    """Of a servo, those in force at the end of the period, N or N m."""
    commanded: Components = (0.0,)
    """Those asked for by this decision, after saturation and fallback."""
    saturated: Component = False
    fallback_used: Component = False
    held: Component = False
    """Whether this decision's command does not arrive."""
    latency: Component = 0.0
    """After which it arrives otherwise, s."""
    iterations: Component = 0
    solver_residual: Component = 0.0
    status: Component = OK
    penetration: Component = 0.0
    """Deepest at the end of any sub-step, m or rad."""
    contact_force: Component = 0.0
    """Generalized force of the stops, or normal force of a contact point: that of largest magnitude
    at the end of any sub-step."""
    slip_loss: Component = 0.0
    """What of the contact loss friction has taken at contact points."""
    stops: Components = ()
    """Of our stops: energy stored at the end of the period, and lost in it; empty without."""
    touches: tuple[Touch, ...] = ()
    """Of each contact point: deepest penetration at the end of any sub-step, the rest at the end of
    the period."""


def quiet_status(setup: Setup) -> int:
    """Code of the solver's status where no step has been taken."""
    return OK if setup.engine.reports else NOT_REPORTED


def initial_state(ops: Ops, setup: Setup, q: Components, v: Components) -> EnvState:
    """Episode state at time 0; no command is under way yet."""
    zero = 0.0 * q[0]
    none = (zero,) * len(setup.plant.controls)
    memory, drawn = setup.timing.memory, setup.timing.drawn
    at_goal = setup.task.at_goal(ops, q, v)
    return EnvState(
        q=q,
        v=v,
        energy=setup.system.energy(ops, q, v),
        commands=(none,) * (memory + drawn),
        fallbacks=(zero == 0.0,) * (memory + drawn),
        arrivals=(zero,) * (memory * drawn),
        sensed_q=q,
        sensed_v=v,
        sensed_time=zero,
        late=((q, v, zero),) * setup.timing.samples,
        steps=0,
        goal_since=ops.where(at_goal, 0.0, AWAY),
    )


def sensed_state(state: EnvState, noise: Components) -> tuple[Components, Components]:
    """Coordinates and velocities at the sensor's last sample.

    Args:
        state: of the episode.
        noise: added to them, in state order, SI units; empty: none.
    """
    q, v = state.sensed_q, state.sensed_v
    if noise:
        by_q, by_v = split_state(noise)
        q = tuple(a + b for a, b in zip(q, by_q, strict=True))
        v = tuple(a + b for a, b in zip(v, by_v, strict=True))
    return q, v


class _Orders(NamedTuple):
    """What is asked of the engine in one control period."""

    commands: tuple[Components, ...]
    """What the next state remembers, as :attr:`EnvState.commands`."""
    fallbacks: tuple[Component, ...]
    arrivals: tuple[Component, ...]
    asked: Segments
    """Of the engine."""
    acting: tuple[tuple[Components, Component], ...]
    """(controls, number of sub-steps), oldest first; where arrivals are drawn, some for none."""
    controls: Components
    """In force at the end of the period."""
    fallback_used: Component
    saturated: Component
    sample_at: Component | None
    """Sub-step (from 1) of the last sample in the period that is shown after it or after later
    ones; 0 or below: none; None: the last sub-step."""
    held: Component = False
    latency: Component = 0.0


def transition(
    ops: Ops,
    setup: Setup,
    state: EnvState,
    action: Components,
    drawn: tuple[Component, Component] | None = None,
) -> tuple[EnvState, Outcome]:
    """Advance one control period under ``action``: one entry per control, or an action's index.

    A diverged motion leaves the state at the start of the period, with nothing booked.

    Args:
        ops: arithmetic.
        setup: of the environment.
        state: at the decision.
        action: decided.
        drawn: where :attr:`Timing.drawn`, two numbers from [0, 1): the command does not arrive if
            the first is below the probability, and is as late as the second says.
    """
    orders = _give_orders(ops, setup, state, setup.task.command(ops, action), drawn)
    try:
        motion = setup.engine.advance(ops, state.q, state.v, orders.asked, orders.sample_at)
    except ArithmeticError:
        still = setup.system.book_carried(setup.system.begin(state.q, state.v))
        motion = still._replace(converged=False, finite=False)
    motion = motion._replace(finite=ops.assume_true(motion.finite))
    after = _next_state(ops, setup, state, orders, motion)
    return after, _outcome(ops, setup, state, after, orders, motion)


def _give_orders(
    ops: Ops,
    setup: Setup,
    state: EnvState,
    command: Command,
    drawn: tuple[Component, Component] | None,
) -> _Orders:
    timing = setup.timing
    none = (0.0,) * len(command.controls)
    held = state.commands[0] if setup.settings.fallback == "hold" else none
    valid = ops.assume_true(command.valid)
    commands = (select(ops, valid, command.controls, held), *state.commands)
    fallbacks = (_negate(valid), *state.fallbacks)
    sample_at, rest = None, timing.sight[1]
    if timing.sensor is not None:
        end = (state.steps + 1) * timing.substeps
        sample_at = end - end % timing.sensor - state.steps * timing.substeps
    elif rest:
        sample_at = timing.substeps - rest
    if drawn is not None:
        return draw_arrival(
            ops, timing, (commands, fallbacks, state.arrivals), command, sample_at, drawn
        )
    segments, used = _segments(timing.delay, timing.substeps, commands, fallbacks)
    commands, fallbacks = commands[: timing.memory], fallbacks[: timing.memory]
    return _Orders(
        commands, fallbacks, (), segments, segments, segments[-1][0], used, command.saturated,
        sample_at,
    )  # fmt: skip


def draw_arrival(
    ops: Ops,
    timing: Timing,
    under_way: tuple[tuple[Components, ...], Components, Components],
    command: Command,
    sample_at: Component | None,
    drawn: tuple[Component, Component],
) -> _Orders:
    """Orders where it is drawn whether and when commands arrive.

    In force is the newest that has arrived: one that arrives after a later decision's is dropped.

    Args:
        ops: arithmetic.
        timing: rates.
        under_way: commands and fallbacks, this decision's first and the one in force last, and
            the arrivals of those between.
        command: this decision's.
        sample_at: see :class:`_Orders`.
        drawn: see :func:`transition`.
    """
    commands, fallbacks, arrivals = under_way
    (periods, rest), substeps, memory = timing.delay, timing.substeps, timing.memory
    held = drawn[0] < timing.hold
    later = ops.minimum(ops.floor(drawn[1] * (timing.jitter + 1.0)), float(timing.jitter))
    late = periods * substeps + rest + later
    arrivals = (ops.where(held, NEVER, late), *arrivals)
    acting, used, end = [], False, substeps
    for k, arrival in enumerate((*arrivals, 0.0)):
        begin = ops.minimum(ops.maximum(arrival, 0.0), end)
        acting.append((commands[k], end - begin))
        used = used | (fallbacks[k] & (begin < end))
        end = begin
    at_end = partial(_newest, ops, arrivals, index=substeps - 1)
    controls = at_end(commands)
    return _Orders(
        (*commands[:memory], controls),
        (*fallbacks[:memory], at_end(fallbacks)),
        tuple([arrival - substeps for arrival in arrivals[:memory]]),
        ((partial(_newest, ops, arrivals, commands), substeps),),
        tuple(reversed(acting)),
        controls,
        used,
        command.saturated,
        sample_at,
        held,
        late * timing.dt,
    )


def _newest(ops: Ops, arrivals: Components, values: tuple[Any, ...], index: Component) -> Any:
    """Of values, newest first and the one in force last, the first that has arrived by a step."""
    value = values[-1]
    for arrival, newer in zip(reversed(arrivals), values[-2::-1], strict=True):
        arrived = arrival <= index
        if isinstance(value, tuple):
            value = select(ops, arrived, newer, value)
        else:
            value = ops.where(arrived, newer, value)
    return value


def _segments(
    delay: tuple[int, int],
    substeps: int,
    commands: tuple[Components, ...],
    fallbacks: tuple[Component, ...],
) -> tuple[Held, Component]:
    """The controls that act in this period, oldest first, and whether one is the fallback's."""
    periods, rest = delay
    recent = (commands[periods], substeps - rest)
    if not rest:
        return (recent,), fallbacks[periods]
    used = fallbacks[periods + 1] | fallbacks[periods]
    return ((commands[periods + 1], rest), recent), used


def _next_state(
    ops: Ops, setup: Setup, state: EnvState, orders: _Orders, motion: Motion
) -> EnvState:
    timing, ok = setup.timing, motion.finite
    q, v = select(ops, ok, motion.q, state.q), select(ops, ok, motion.v, state.v)
    steps = state.steps + 1
    time = steps * timing.control_period
    arrived = ops.where(state.goal_since >= 0.0, state.goal_since, time)
    shown, late = _show(ops, setup, state, orders, motion)
    return EnvState(
        q=q,
        v=v,
        energy=setup.system.energy(ops, q, v),
        commands=orders.commands,
        fallbacks=orders.fallbacks,
        arrivals=orders.arrivals,
        sensed_q=shown[0],
        sensed_v=shown[1],
        sensed_time=shown[2],
        late=late,
        steps=steps,
        goal_since=ops.where(setup.task.at_goal(ops, q, v), arrived, AWAY),
    )


def _show(
    ops: Ops, setup: Setup, state: EnvState, orders: _Orders, motion: Motion
) -> tuple[tuple[Components, Components, Component], tuple[Any, ...]]:
    """The sample that is shown after a period, and those under way, newest first."""
    timing, sampled = setup.timing, _sampled(orders, motion.finite)
    shown = state.sensed_q, state.sensed_v, state.sensed_time
    q, v, time = state.late[0] if state.late else shown
    newest = (
        select(ops, sampled, motion.sampled_q, q),
        select(ops, sampled, motion.sampled_v, v),
        ops.where(sampled, _sample_time(timing, state.steps, orders.sample_at), time),
    )
    under_way = (newest, *state.late)
    return under_way[timing.sight[0]], under_way[: timing.samples]


def _outcome(
    ops: Ops, setup: Setup, before: EnvState, after: EnvState, orders: _Orders, motion: Motion
) -> Outcome:
    timing, task, ok = setup.timing, setup.task, motion.finite
    work = ops.where(ok, motion.work, 0.0)
    dissipated = ops.where(ok, motion.losses[0], 0.0)
    clip_loss = ops.where(ok, motion.clip_loss, 0.0)
    contact_loss = penetration = contact_force = 0.0
    if len(motion.losses) > 1:
        contact_loss = ops.where(ok, reduce(add, motion.losses[1:]), 0.0)
        penetration = ops.where(ok, motion.penetration, 0.0)
        contact_force = ops.where(ok, motion.contact_force, 0.0)
    stops = ()
    if setup.system.stops is not None:
        stored = setup.system.stops.contact(ops, after.q, after.v).energy
        stops = tuple([ops.where(ok, x, 0.0) for x in (stored, motion.losses[1])])
    touches = _touches(ops, setup, after, motion)
    slip_loss = reduce(add, [touch.slip_loss for touch in touches], 0.0)
    failed = task.terminated(ops, after.q, after.v) & ok
    terminated = failed | _negate(ok)
    truncated = after.steps >= timing.horizon
    stayed = after.steps * timing.control_period - after.goal_since
    rounding = max(1e-9, 64.0 * ops.epsilon)
    reached = (after.goal_since >= 0.0) & (stayed >= task.goal_stay * (1.0 - rounding))
    if getattr(task, "ends_at_goal", False):
        success = ops.assume_false(failed) & reached
    else:
        success = ops.assume_false(truncated) & (reached & _negate(terminated))
    period, squares = timing.control_period, _mean_squares(orders.acting, timing.substeps)
    if motion.efforts:
        squares = tuple([ops.where(ok, x, 0.0) / period for x in motion.squares])
    earned = task.reward(ops, before.q, before.v, squares, failed, period)
    left = ops.maximum(timing.horizon - before.steps, 1)
    worst = task.worst_return(ops, left, period, top_speed(setup))
    newer = after.sensed_time != before.sensed_time
    solved = ops.where(motion.converged, quiet_status(setup), NOT_CONVERGED)
    efforts = tuple([ops.where(ok, x, 0.0) for x in motion.efforts])
    saturated = orders.saturated
    if efforts:
        saturated = saturated | setup.system.at_effort_limit(efforts)
    return Outcome(
        reward=ops.where(ok, earned, worst),
        terminated=terminated,
        truncated=truncated,
        success=success,
        sampled=newer if timing.sight[0] else _sampled(orders, ok),
        work=work,
        dissipated=dissipated,
        contact_loss=contact_loss,
        clip_loss=clip_loss,
        residual_energy=after.energy - before.energy - work + dissipated + contact_loss + clip_loss,
        controls=orders.controls,
        efforts=efforts,
        commanded=orders.commands[0],
        saturated=saturated,
        fallback_used=orders.fallback_used,
        held=orders.held,
        latency=orders.latency,
        iterations=motion.iterations,
        solver_residual=ops.where(ok, motion.residual, 0.0),
        status=ops.where(ok, solved, DIVERGED),
        penetration=penetration,
        contact_force=contact_force,
        slip_loss=slip_loss,
        stops=stops,
        touches=touches,
    )


def _touches(ops: Ops, setup: Setup, after: EnvState, motion: Motion) -> tuple[Touch, ...]:
    reactions = setup.system.reactions(ops, after.q, after.v)
    depths = motion.depths or (0.0,) * len(reactions)
    lost = motion.losses[len(motion.losses) - 2 * len(reactions) :]
    booked = zip(reactions, depths, lost[::2], lost[1::2], strict=True)
    touches = [
        reaction.touch._replace(penetration=depth, contact_loss=taken + slip, slip_loss=slip)
        for reaction, depth, taken, slip in booked
    ]
    return map_leaves(lambda x: ops.where(motion.finite, x, 0.0), tuple(touches))  # type: ignore[no-any-return]


def _negate(condition: Component) -> Component:
    return condition == False  # noqa: E712


def _sampled(orders: _Orders, ok: Component) -> Component:
    return ok if orders.sample_at is None else (orders.sample_at > 0) & ok


def _sample_time(timing: Timing, steps: Component, sample_at: Component | None) -> Component:
    if sample_at is None:
        return (steps + 1) * timing.control_period
    return (steps * timing.substeps + sample_at) * timing.dt


def _mean_squares(acting: tuple[tuple[Components, Component], ...], substeps: int) -> Components:
    """Time average of each squared control over the period."""
    if len(acting) == 1:
        return tuple([u * u for u in acting[0][0]])
    counts = [count for _, count in acting]
    return tuple(
        [
            sum(count * (u * u) for u, count in zip(values, counts, strict=True)) / substeps
            for values in zip(*(controls for controls, _ in acting), strict=True)
        ]
    )


def top_speed(setup: Setup) -> Component:
    """Largest speed a motion can have without diverging, rad/s or m/s."""
    return DIVERGENCE_SPEED if setup.system.max_speed is None else setup.system.max_speed


LOSSES = ("dissipated", "contact_loss", "clip_loss")
"""What is taken out of a plant's energy, by its names."""


def reset_info(setup: Setup, state: EnvState) -> dict[str, Any]:
    """`info` of a reset: the keys of a step, nothing booked."""
    none = (0.0,) * len(setup.plant.controls)
    quiet = Outcome(
        controls=none,
        efforts=(0.0,) * len(list(effort_columns(setup.plant))),
        commanded=none,
        status=quiet_status(setup),
        stops=(0.0, 0.0) if setup.system.stops else (),
        touches=(Touch(),) * len(setup.system.contacts),
    )
    return {**step_info(setup, state, quiet), "time": 0.0, "sensor_time": 0.0}


def blank_info(setup: Setup) -> dict[str, Any]:
    """`info` of a reset, but for what depends on the start."""
    still = EnvState((), (), 0.0, (), (), (0.0,) * setup.timing.drawn, (), (), 0.0, (), 0, AWAY)
    return reset_info(setup, still)


def effort_columns(plant: Any) -> Iterator[tuple[str, int]]:
    """Name in `info` and coordinate of each effort of a servo; none of a plant without one."""
    if hasattr(plant, "servo_of"):
        for place in plant.actuated:
            yield f"{plant.coordinates[place]}_effort", place


def control_columns(plant: Any) -> Iterator[tuple[str, str]]:
    """Names in `info` of each control asked for and in force: a single one has none of its own."""
    if len(plant.controls) == 1:
        yield "commanded", "control"
        return
    for name, _ in plant.controls:
        yield f"{name}_commanded", f"{name}_applied"


def step_info(setup: Setup, state: EnvState, outcome: Outcome) -> dict[str, Any]:
    """`info` of a step."""
    names = list(control_columns(setup.plant))
    asked = {name: x for (name, _), x in zip(names, outcome.commanded, strict=True)}
    columns = zip(effort_columns(setup.plant), outcome.efforts, strict=True)
    efforts = {name: x for (name, _), x in columns}
    applied = {name: x for (_, name), x in zip(names, outcome.controls, strict=True)}
    info = {
        "time": state.steps * setup.timing.control_period,
        "energy": state.energy,
        "actuator_work": outcome.work,
        "dissipated": outcome.dissipated,
        "contact_loss": outcome.contact_loss,
        "clip_loss": outcome.clip_loss,
        "energy_residual": outcome.residual_energy,
        **applied,
        **asked,
        **efforts,
        "saturated": outcome.saturated,
        "fallback_used": outcome.fallback_used,
        "sensor_time": state.sensed_time,
        "penetration": outcome.penetration,
        "contact_force": outcome.contact_force,
        "goal_since": state.goal_since,
        "success": outcome.success,
        "solver_iterations": outcome.iterations,
        "solver_residual": outcome.solver_residual,
        "solver_status": outcome.status,
    }
    if state.arrivals:
        info |= {"command_held": outcome.held, "command_latency": outcome.latency}
    return info | _contact_info(setup, outcome)


def _contact_info(setup: Setup, outcome: Outcome) -> dict[str, Any]:
    """Further entries of `info` of a plant with stops of ours or contact points."""
    stops: dict[str, Any] = {}
    if outcome.stops:
        stops["stop_stored_energy"], stops["stop_contact_loss"] = outcome.stops
    if not outcome.touches:
        return stops
    names: tuple[str, ...] = setup.plant.contact_names  # type: ignore[attr-defined]
    figures = {
        f"{name}_{figure}": value
        for name, touch in zip(names, outcome.touches, strict=True)
        for figure, value in touch._asdict().items()
    }
    return {"slip_loss": outcome.slip_loss, **stops, **figures}


RESULTS = ("reward", "terminated", "truncated", "sampled")
"""What a step of arrays returns beside `info`."""


def scalar_start(setup: Setup, ops: Ops, q: Components, v: Components) -> tuple[Any, ...]:
    state = initial_state(ops, setup, q, v)
    observation = setup.task.observe(ops, state.q, state.v)
    return tuple(state), observation, reset_info(setup, state)


def scalar_step(setup: Setup, ops: Ops, state: tuple[Any, ...], *given: Any) -> tuple[Any, ...]:
    """One control period of floats.

    Args:
        setup: of the environment.
        ops: arithmetic.
        state: as :class:`EnvState`.
        given: what is drawn, see :func:`transition`, if it is; then the action.
    """
    *drawn, action = given
    after, outcome = transition(ops, setup, EnvState._make(state), action, *drawn)
    return (
        tuple(after),
        setup.task.observe(ops, after.sensed_q, after.sensed_v),
        outcome.reward,
        outcome.terminated,
        outcome.truncated,
        step_info(setup, after, outcome),
        outcome.sampled,
    )


def array_step(
    setup: Setup, ops: Ops, state: tuple[Any, ...], *given: Any
) -> tuple[EnvState, Components, dict[str, Any]]:
    """The same of arrays."""
    *drawn, action = given
    after, outcome = transition(ops, setup, EnvState._make(state), action, *drawn)
    values = step_info(setup, after, outcome) | {n: getattr(outcome, n) for n in RESULTS}
    return after, setup.task.observe(ops, after.sensed_q, after.sensed_v), values
