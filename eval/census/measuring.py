"""What is measured of a pendulum or a cart-pole: its map, its drift and its limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import UTC, datetime
from functools import partial
from typing import Any, Literal

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.engines.maps import map_names, one_step_map
from integ_gym.envs.engines.stepping import integrators_of, missing_modules
from integ_gym.envs.ops.ops import SCALAR, join_state
from integ_gym.envs.plants.interface import Plant
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.registries import TRUTH
from integ_gym.evidence.record import plain
from integ_gym.support.errors import describe_exception
from integ_gym.support.optional import install_command, installed_versions

from . import subjects


@dataclass(frozen=True)
class Drift:
    """Energy of a free motion against that of the exact solution from the same start.

    Energies are relative to that at the start; zero is at rest hanging.

    Attributes:
        start: (q, v), SI units.
        duration: s.
        end: energy at the end less that of the exact solution; `inf` where the motion diverged.
        largest: largest magnitude of that difference at any instant of control.
        energies: at the instants of control.
        exact_energies: of the exact solution at the same instants.
    """

    start: subjects.State
    duration: float
    end: float
    largest: float
    energies: tuple[float, ...]
    exact_energies: tuple[float, ...]


def energy_drift(plant: Plant, states: Sequence[subjects.State], period: float) -> Drift:
    """Follow the energy of a free motion.

    Args:
        plant: what moves.
        states: at instants ``period`` seconds apart.
        period: s.
    """
    system, exact_states = PlantSystem(plant), [states[0]] * len(states)
    if any(getattr(plant, name) for name in numerics.damping_parameters(plant)):
        for k in range(1, len(states)):
            start = join_state(*exact_states[k - 1])
            end = numerics.advance("reference", plant, start, period)
            exact_states[k] = tuple(end[0::2]), tuple(end[1::2])

    def energy(state: subjects.State) -> float:
        try:
            return float(system.energy(SCALAR, *state))
        except (ArithmeticError, ValueError):  # of a component that is not finite
            return math.nan

    measured, exact = (
        np.array([energy(state) for state in motion]) for motion in (states, exact_states)
    )
    difference = np.abs(measured - exact) / exact[0]
    worst = float(difference.max()) if np.isfinite(difference).all() else math.inf
    return Drift(
        start=states[0],
        duration=period * (len(states) - 1),
        end=float((measured[-1] - exact[-1]) / exact[0]) if worst < math.inf else math.inf,
        largest=worst,
        energies=tuple((measured / exact[0]).tolist()),
        exact_energies=tuple((exact / exact[0]).tolist()),
    )


SUBSTEPS = (1, 2, 3, 4, 5, 8, 10, 20)
"""Integration steps in one control period that are tried, beside the stated number."""

SCREENED = 3
"""Control periods of each sample by which unlikely candidates are sorted out."""

CORRECTIONS = 8
"""Gauss-Newton corrections of the length of a control period, at most."""


@dataclass(frozen=True)
class Found:
    """What a control period is made of.

    Attributes:
        map: the known map that is nearest.
        equal_maps: all maps that it cannot be distinguished from.
        substeps: steps of it in one control period.
        dt: of one step, s.
        defect: largest error of one control period against it, relative to 1 + |value|.
        identified: whether that is no more than the arithmetic.
        runner_up: the nearest map that it can be distinguished from, and its defect.
        truth_defect: largest error of one control period against the exact solution over the
            stated time.
    """

    map: str
    equal_maps: tuple[str, ...]
    substeps: int
    dt: float
    defect: float
    identified: bool
    runner_up: tuple[str, float]
    truth_defect: float

    @property
    def control_period(self) -> float:
        """Time that one control period takes, s."""
        return self.substeps * self.dt


def identify(samples: Sequence[subjects.Sample], stated: subjects.Statement, width: int) -> Found:
    """Search for the map, the number of steps and, failing that, the length of a control period.

    Args:
        samples: control periods.
        stated: tried first.
        width: bits of the floats in which they were seen.
    """
    limit = numerics.IDENTICAL[width]
    found = _find_nearest_map(samples, stated, stated.substeps, stated.control_period, limit)
    if found.identified:
        return found
    for count, length, names in _candidates(samples, stated):
        errors = (
            max(numerics.largest_error(*both) for both in _few(samples, name, count, length))
            for name in names
        )
        if min(errors) <= limit:
            other = _find_nearest_map(samples, stated, count, length, limit)
            if other.identified:
                return other
    return found


def _candidates(
    samples: Sequence[subjects.Sample], stated: subjects.Statement
) -> Iterator[tuple[int, float, Sequence[str]]]:
    """Numbers of steps, lengths of a control period in seconds, and maps for which to try them."""
    others = [n for n in SUBSTEPS if n != stated.substeps]
    for count in others:
        yield count, stated.control_period, map_names()
    for count in (stated.substeps, *others):
        for name in map_names():
            fitted = _fit_period(samples, name, count)
            if fitted is not None:
                yield count, fitted, (name,)


def _find_nearest_map(
    samples: Sequence[subjects.Sample],
    stated: subjects.Statement,
    count: int,
    period: float,
    limit: float,
) -> Found:
    """The nearest map in ``count`` steps over ``period``."""
    names = (*map_names(), TRUTH)
    defects = dict.fromkeys(names, 0.0)
    for sample in samples:
        found = numerics.match(sample.step, sample.plant, period, sample.cases, names, count)
        defects = {name: max(defects[name], found.defects[name]) for name in names}
    ranked = sorted(names, key=lambda n: (max(defects[n], limit), n != stated.map))
    equal = tuple(n for n in ranked if defects[n] <= limit) or ranked[:1]
    other, first = next(n for n in ranked if n not in equal), samples[0]
    return Found(
        map=ranked[0],
        equal_maps=tuple(equal),
        substeps=count,
        dt=period / count,
        defect=defects[ranked[0]],
        identified=defects[ranked[0]] <= limit,
        runner_up=(other, defects[other]),
        truth_defect=numerics.match(
            first.step, first.plant, stated.control_period, first.cases, (TRUTH,)
        ).defect,
    )


def _fit_period(samples: Sequence[subjects.Sample], name: str, count: int) -> float | None:
    """The length of a control period with which a map is nearest, s; None where it fails."""

    def residuals(period: float) -> np.ndarray:
        few = _few(samples, name, count, period)
        return np.concatenate([np.concatenate(got) - np.concatenate(end) for got, end in few])

    pairs = [
        (after - before, 0.5 * (slow + fast))
        for sample in samples
        for (q, v, _), (end_q, end_v) in sample.transitions
        for before, after, slow, fast in zip(q, end_q, v, end_v, strict=True)
    ]
    moved, speed = np.array(pairs).T
    # Displacement over mean velocity: the length of a control period to its second order.
    period, before = abs(float(moved @ speed / (speed @ speed))), math.inf
    for _ in range(CORRECTIONS):
        here, ahead = residuals(period), residuals(period * (1.0 + 1e-6))
        slopes = (ahead - here) / (period * 1e-6)
        if not (np.isfinite(slopes).all() and slopes.any()):
            return None
        if np.linalg.norm(here) > 0.5 * before:
            return period
        before = float(np.linalg.norm(here))
        period -= float(slopes @ here / (slopes @ slopes))
        if not 0.0 < period < math.inf:
            return None
    return period


def _few(
    samples: Sequence[subjects.Sample], name: str, count: int, period: float
) -> Iterator[tuple[subjects.State, subjects.State]]:
    """Where a map ends, and where the subject did, after a few control periods of each sample."""
    for sample in samples:
        for case, end in sample.transitions[:SCREENED]:
            yield numerics.mapped(name, sample.plant, period / count, count, case), end


CUT = 1e-4
"""Relative difference between a velocity and the map's that rounding cannot explain."""


@dataclass(frozen=True)
class SpeedLimit:
    """What was found of a speed limit.

    Attributes:
        fastest: highest speed with which a control period began, rad/s or m/s.
        limit: the speed to which all faster ones are cut; None: they are not.
        moves_by: whether positions advance with the `cut` or the `uncut` velocity; None without a
            limit, and where the map advances them with the earlier one.
        slowed: whether it is slower than the map at high speeds, and not by a limit.
    """

    fastest: float
    limit: float | None = None
    moves_by: Literal["cut", "uncut"] | None = None
    slowed: bool = False


def find_speed_limit(sample: subjects.Sample, found: Found) -> SpeedLimit:
    """Compare fast control periods with the map that was found at lower speeds."""
    fastest = max(abs(x) for (_, v, _), _ in sample.transitions for x in v)

    def mapped(one: subjects.Transition, most: float | None = None) -> subjects.State:
        case = one.case
        return numerics.mapped(found.map, sample.plant, found.dt, found.substeps, case, most)

    cut = [  # those that end slower than the map says
        one
        for one in sample.transitions
        if any(
            math.isfinite(x) and abs(x) - abs(got) > CUT * (1.0 + abs(x))
            for x, got in zip(mapped(one)[1], one.end[1], strict=True)
        )
    ]
    if not cut:
        return SpeedLimit(fastest)
    speeds = [max(map(abs, one.end[1])) for one in cut]
    limit = max(speeds)
    if limit - min(speeds) > CUT * limit:
        return SpeedLimit(fastest, slowed=True)
    by_cut, by_uncut = (
        max(numerics.largest_error((one.end[0], ()), (mapped(one, most)[0], ())) for one in cut)
        for most in (limit, None)
    )
    if math.isclose(by_cut, by_uncut, abs_tol=CUT):
        return SpeedLimit(fastest, limit)
    return SpeedLimit(fastest, limit, "cut" if by_cut < by_uncut else "uncut")


SAME_TIME = 1e-5
"""Relative difference up to which two times are the same."""

DRAWN = 100
"""Intervals between the energies of a free motion that are kept."""


@dataclass(frozen=True)
class Line:
    """What was found of a subject.

    Attributes:
        subject: what was looked at, and is held no longer: engines may be processes.
        found: what its control period is made of.
        speed_limit: None where nothing was identified that it could be distinguished from.
        drift: None where a free motion cannot be had.
        swing_period: of small oscillations about hanging, s.
        authority: largest control over the largest torque of gravity, or over the weight.
    """

    subject: subjects.Subject
    found: Found
    speed_limit: SpeedLimit | None
    drift: Drift | None
    swing_period: float
    authority: float

    @property
    def differences(self) -> tuple[str, ...]:
        """In what it is not what it is said to be, as sentences."""
        return tuple(_differences(self))

    def to_json(self) -> dict[str, Any]:
        """As plain data; what is not finite is null."""
        subject, plant = self.subject, self.subject.plant
        names = ("source", "name", "version", "published")
        drift = self.drift and asdict(self.drift)
        if drift:  # with every so many of its energies, in the digits that a curve shows
            every = max(1, math.ceil((len(drift["energies"]) - 1) / DRAWN))
            for name in ("energies", "exact_energies"):
                drift[name] = plain(drift[name][::every], 5)
        line: dict[str, Any] = {
            **{name: getattr(subject, name) for name in names},
            "plant": plant.name,
            "parameters": {f.name: getattr(plant, f.name) for f in fields(plant)},  # type: ignore[arg-type]
            "swing_period": self.swing_period,
            "max_control": subject.max_control,
            "authority": self.authority,
            "width": subject.width,
            "note": subject.note,
            "stated": {**asdict(subject.stated), "dt": subject.stated.dt},
            "found": asdict(self.found),
            "speed_limit": self.speed_limit and asdict(self.speed_limit),
            "drift": drift,
            "differences": self.differences,
        }
        return {name: plain(value) for name, value in line.items()}


def measure(subject: subjects.Subject) -> Line:
    """Look at a subject."""
    plant: Any = subject.plant
    access = subject.access
    assert access is not None
    found = identify(access.samples(subject), subject.stated, subject.width)
    states = access.coast(subject)
    limit = find_speed_limit(access.drive(subject), found) if found.identified else None
    free = replace(plant, **dict.fromkeys(numerics.damping_parameters(plant), 0.0))
    n = len(plant.coordinates)
    hanging = join_state((*(0.0,) * (n - 1), math.pi), (0.0,) * n)
    return Line(
        subject=replace(subject, access=None),
        found=found,
        speed_limit=limit,
        drift=energy_drift(plant, states, subject.stated.control_period) if states else None,
        swing_period=math.tau / numerics.fastest_rate(free, hanging),
        authority=subject.max_control / _weight(plant),
    )


def _weight(plant: Any) -> float:
    """Largest torque of gravity at the pendulum's hinge, N m; weight of the cart-pole, N."""
    n = len(plant.coordinates)
    level, still = (*(0.0,) * (n - 1), 0.5 * math.pi), (0.0,) * n
    mass = plant.mass_matrix(SCALAR, level)
    if n == 1:
        return float(mass[0][0] * plant.acceleration(SCALAR, level, still, still)[0])
    return float(mass[0][0] * plant.gravity)


def _differences(line: Line) -> list[str]:
    found, stated = line.found, line.subject.stated
    if not found.identified:
        return [
            f"no known map: the nearest, {found.map}, is {found.defect:.0e} off in one control "
            "period"
        ]
    said = []
    if stated.map is not None and stated.map not in found.equal_maps:
        said.append(f"said to be {stated.map}, is {found.map}")
    if abs(found.control_period / stated.control_period - 1.0) > SAME_TIME:
        said.append(
            f"said to take {stated.control_period:g} s a control period, takes "
            f"{found.control_period:.4g} s"
        )
    elif found.substeps != stated.substeps:
        said.append(
            f"said to take {stated.substeps} steps a control period, takes {found.substeps}"
        )
    limit, most = line.speed_limit, stated.max_speed
    if limit is None:
        return said
    if limit.slowed:
        said.append("is slower than its map at high speeds")
    elif most is None and limit.limit is not None:
        said.append(f"cuts speeds at {limit.limit:.4g} without saying so")
    elif most is not None and limit.limit is None and limit.fastest > most:
        said.append(f"said to cut speeds at {most:g}, does not")
    elif limit.moves_by == "uncut":
        said.append("moves by the velocity from before its speed limit")
    return said


SCHEMA_VERSION = 1
PACKAGES = ("integ-gym", "numpy", "gymnasium", "jax", "mujoco", "mujoco-mjx", "warp-lang")
"""Packages whose version is recorded beside those of the lines."""


@dataclass
class Census:
    """What was found.

    Attributes:
        lines: one for each environment, and for each integrator of an engine and plant.
        missing: source to the command that installs it.
        failed: source to why it could not be looked at.
    """

    lines: list[Line] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)

    def to_json(self, command: str) -> dict[str, Any]:
        """Content of ``census.json``."""
        return {
            "schema_version": SCHEMA_VERSION,
            "command": command,
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
            "versions": installed_versions(PACKAGES),
            "free_motion_seconds": subjects.COAST,
            "maps": {name: _about(name) for name in (*map_names(), TRUTH)},
            "lines": [line.to_json() for line in self.lines],
            "missing": self.missing,
            "failed": self.failed,
        }


def take_census(
    libraries: Sequence[str], engines: Sequence[str], tell: Callable[[str], None]
) -> Census:
    """Look at everything of some libraries and engines that is installed.

    What a library or engine raises is noted, and the others are looked at.

    Args:
        libraries: registered names, or ``"module:Class"`` of your own.
        engines: registered names.
        tell: called with a line before each source is looked at.

    Raises:
        ValueError: for an unknown name.
    """
    census = Census()
    for name in libraries:
        library = subjects.PUBLISHED.load(name)()
        if not subjects.installed(name):
            census.missing[library.title] = library.install
        else:
            tell(library.title)
            _look(census, library.title, library.subjects)
    for name in engines:
        if missing_modules(name):
            census.missing[name] = install_command(name)
        else:
            tell(name)
            _look(census, name, partial(subjects.engine_subjects, name, integrators_of(name)))
    return census


def _about(name: str) -> str:
    """The first sentence of a map's description."""
    return " ".join(str(one_step_map(name).__doc__).split("\n\n")[0].split())


def _look(census: Census, source: str, subjects: Callable[[], Iterator[subjects.Subject]]) -> None:
    try:
        for subject in subjects():
            census.lines.append(measure(subject))
            del subject  # before the next one is made
    except Exception as error:  # whatever the code of others does
        census.failed[source] = describe_exception(error)
