"""Cells of a panel: discretizations, mixtures, perturbations and sweeps, read from tables."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, TypeAlias

from integ_gym.envs.engines.maps import map_names
from integ_gym.envs.engines.stepping import missing_modules
from integ_gym.envs.environment import is_integ_environment
from integ_gym.envs.lanes import DiscretizedVectorEnv
from integ_gym.envs.registries import ENGINES
from integ_gym.envs.settings import (
    DISCRETIZATION,
    NATIVE,
    WEIGHT,
    Discretization,
    dividing_step,
)
from integ_gym.envs.testbeds.gym_testbed import Testbed
from integ_gym.envs.testbeds.making import make_checked
from integ_gym.support.errors import InputError, IntegGymError
from integ_gym.support.isolated import ISOLATED
from integ_gym.support.optional import install_command, running_version
from integ_gym.support.parameters import unknown_name

LARGEST_SEED = 2**32 - 1


class SpecError(IntegGymError, ValueError):
    """A specification that cannot be run, in one sentence with the remedy."""


def check_keys(kind: str, data: Mapping[str, Any], valid: Sequence[str]) -> None:
    """Refuse keys of a table that mean nothing."""
    for key in data:
        check_known(kind, key, valid)


def check_known(kind: str, name: str, valid: Iterable[str]) -> None:
    """Refuse a name that is not among the valid ones, which are listed."""
    if name not in valid:
        raise SpecError(unknown_name(kind, name, valid))


def check_unique(label: str, values: Sequence[Any]) -> None:
    """Refuse a list that holds something twice."""
    if len(set(values)) != len(values):
        raise SpecError(f"`{label}` lists something twice: {list(values)}")


def many(value: Any) -> list[Any]:
    """A list, or a single value as one."""
    return value if isinstance(value, list) else [value]


def list_of(data: Mapping[str, Any], key: str) -> list[Any]:
    """A list under a key; empty where it is left out."""
    value = data.get(key, [])
    if not isinstance(value, list):
        raise SpecError(f"`{key}` must be a list, got {value!r}")
    return value


def table(data: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """A table under a key; empty where it is left out."""
    value = data.get(key, {})
    if not isinstance(value, Mapping):
        raise SpecError(f"`{key}` must be a table, got {value!r}")
    return value


def text(key: str, value: Any) -> str:
    """A name."""
    if not isinstance(value, str) or not value:
        raise SpecError(f"`{key}` must be made of names in quotes, got {value!r}")
    return value


def flag(key: str, value: Any) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise SpecError(f"`{key}` must be true or false, got {value!r}")
    return value


def positive(key: str, value: Any) -> float:
    """A finite number above 0."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < math.inf:
        raise SpecError(f"`{key}` must be a finite number above 0, got {value!r}")
    return float(value)


def integer(key: str, value: Any) -> int:
    """A whole number from 0 to `LARGEST_SEED`."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= LARGEST_SEED:
        raise SpecError(
            f"`{key}` must be made of whole numbers from 0 to {LARGEST_SEED}, got {value!r}"
        )
    return value


def pair_of(key: str, value: Any) -> tuple[str, str]:
    """Two names."""
    if not isinstance(value, list) or len(value) != 2:
        raise SpecError(f"every entry of `{key}` must be a pair of names, got {value!r}")
    return str(value[0]), str(value[1])


@dataclass(frozen=True)
class DiscretizationMixture:
    """Discretizations of one control period, one of which every training episode draws.

    Attributes:
        name: of the mixture.
        weights: by member; its share is its weight over the sum of all.
    """

    name: str
    weights: tuple[tuple[Discretization, float], ...]

    @property
    def shares(self) -> dict[Discretization, float]:
        """Share of each discretization that training draws from."""
        total = sum(weight for _, weight in self.weights)
        return {member: weight / total for member, weight in self.weights}

    @property
    def control_period(self) -> float:
        """Time between two decisions, s."""
        return self.weights[0][0].control_period

    def arguments(self) -> list[dict[str, Any]]:
        """The members, each as constructor arguments of an environment."""
        return [member.arguments() for member, _ in self.weights]


UNNAMED = "its mixture"
"""What the mixture of a policy that was given is called."""

Home: TypeAlias = Discretization | DiscretizationMixture
"""What a policy is trained on."""


def main_home(home: Home | None) -> Discretization | None:
    """The discretization that most of the training ran on, the first of equals; None: unknown."""
    shares = {} if home is None else home.shares
    return max(shares, key=lambda member: shares[member], default=None)


@dataclass(frozen=True)
class Perturbation:
    """Environment arguments that differ from the panel's, on the home and reference cells."""

    name: str
    environment: Mapping[str, Any]


@dataclass(frozen=True)
class Cell:
    """One evaluation column: a discretization, perturbed or not."""

    discretization: Discretization
    kind: str
    """`grid`, `reference`, `perturbation` or `ladder` (the control period follows dt)."""
    perturbation: Perturbation | None = None
    role: str | None = None
    """`reference` or `quarter_step` where the cell decides a comparison of policies."""

    @property
    def name(self) -> str:
        """Unique within a panel."""
        base = self.discretization.name
        if self.kind == "ladder":
            base = f"{base} control={self.discretization.control_period:g}"
        return f"{base}, {self.perturbation.name}" if self.perturbation else base

    def arguments(self, environment: Mapping[str, Any]) -> dict[str, Any]:
        """Constructor arguments of this cell's environment."""
        values = {**environment, **self.discretization.arguments(), **changes_of(self)}
        if self.discretization.integrator == "reference":
            values["dt"] = dividing_step(values)
        return values


def changes_of(cell: Cell) -> Mapping[str, Any]:
    """Arguments that a cell's perturbation changes."""
    return cell.perturbation.environment if cell.perturbation else {}


def environments_of(
    testbed: Testbed, cell: Cell, lanes: int, **changed: Any
) -> DiscretizedVectorEnv:
    """A cell's environments.

    Args:
        testbed: what makes them.
        cell: where.
        lanes: number of environments.
        changed: arguments that differ from the cell's.

    Raises:
        TypeError, ValueError: for a cell that cannot be made.
    """
    given = {**cell.arguments(testbed.arguments), **changed}
    asked = Discretization(**{name: given.pop(name) for name in DISCRETIZATION})
    return make_checked(testbed, asked, lanes, **given)


@lru_cache(maxsize=16)
def nominal_setup(testbed: Testbed, control_period: float) -> Any:
    """The setup of the undisturbed task on its truth, or at home where there is none.

    Baselines are designed from its parameters.
    """
    cell = Cell(testbed.truth(control_period) or testbed.home, "grid")
    environments = environments_of(testbed, cell, 1)
    environments.close()
    return environments.setups[0]


def training_arguments(home: Home, environment: Mapping[str, Any]) -> dict[str, Any]:
    """Constructor arguments of a training environment.

    Args:
        home: what is trained on.
        environment: arguments common to all discretizations.
    """
    if isinstance(home, Discretization):
        return Cell(home, "grid").arguments(environment)
    own = ("engine", "integrator", "dt")
    cells = [(Cell(d, "grid").arguments(environment), weight) for d, weight in home.weights]
    mixture = [{**{name: a[name] for name in own}, WEIGHT: weight} for a, weight in cells]
    common = {name: value for name, value in cells[0][0].items() if name not in own}
    return {**common, "mixture": mixture}


def file_name(row: str) -> str:
    """A row's name as that of its files."""
    return re.sub(r"[^A-Za-z0-9._]+", "-", row)


INSTALLED = "installed"
"""In place of an engine's name: every installed one but the native."""

_EASIEST = "mujoco"
"""Of the engines that could be installed, where it serves."""


def check_some_installed(grid: Iterable[Discretization], maps: Sequence[str]) -> None:
    """Refuse a panel that is about engines where it has none but the native one.

    Args:
        grid: its discretizations.
        maps: names of the one-step maps that it asks of installed engines.

    Raises:
        SpecError: with the command that installs one.
    """
    if any(discretization.engine != NATIVE for discretization in grid):
        return
    serving = [
        name
        for name in absent_engines()
        if name not in ISOLATED and integrator_applying(name, maps)
    ]
    name = min(serving or [_EASIEST], key=lambda name: name != _EASIEST)
    raise SpecError(
        "it is about other engines, and none that it could use is installed; run: "
        f"{install_command(name)}, or see `integ-gym engines` for the others"
    )


def foreign_engines() -> tuple[str, ...]:
    """Names of all engines but the native one, installed or not."""
    return tuple(name for name in ENGINES.names() if name != NATIVE)


def absent_engines() -> tuple[str, ...]:
    """Names of the engines whose extra is not installed."""
    return tuple(name for name in foreign_engines() if missing_modules(name))


def installed_engines() -> tuple[str, ...]:
    """Names of the installed engines, without the native one."""
    return tuple(name for name in foreign_engines() if not missing_modules(name))


def integrator_applying(engine: str, maps: Sequence[str]) -> str | None:
    """An engine's own name for the first of some one-step maps that it applies.

    Args:
        engine: registered name, not the native one.
        maps: names of one-step maps, the preferred one first.

    Returns:
        The first such integrator in the engine's order, or None if it applies none of the maps.
    """
    own = ENGINES.load(engine).maps
    return next((name for wanted in maps for name in own if own[name] == wanted), None)


def map_of(discretization: Discretization) -> str:
    """The one-step map that a discretization applies."""
    maps = ENGINES.load(discretization.engine).maps
    return str(maps.get(discretization.integrator, discretization.integrator))


def is_engine(name: str) -> bool:
    """Whether a name is of an engine of ours or a user's; a testbed's own is its package."""
    return ":" in name or name in ENGINES


def engine_versions(engines: Iterable[str]) -> dict[str, str]:
    """Distribution and version behind each engine, this package itself left out."""
    packages = {ENGINES.load(n).package if is_engine(n) else n for n in engines} - {"integ-gym"}
    return {package: running_version(package) for package in sorted(packages)}


def on_installed(entry: Mapping[str, Any]) -> list[dict[str, Any]]:
    """A table of ``engine = "installed"`` and ``map`` as one table per installed engine.

    Args:
        entry: with ``map``, one name or several, the preferred one first, and ``dt``.

    Returns:
        Tables of ``engine``, ``integrator`` and ``dt``; engines that apply none of the maps are
        left out.

    Raises:
        ValueError: for an integrator, which engines call differently, and for unknown maps.
    """
    if "integrator" in entry or "map" not in entry:
        raise InputError(
            f'engine "{INSTALLED}" takes `map` in place of `integrator`, for engines call their '
            f"integrators differently; known maps: {', '.join(map_names())}"
        )
    maps = many(entry["map"])
    for name in maps:
        check_known("map in `evaluate`", str(name), map_names())
    chosen = {engine: integrator_applying(engine, maps) for engine in installed_engines()}
    others = {key: value for key, value in entry.items() if key not in ("engine", "map")}
    return [
        {"engine": engine, "integrator": integrator, **others}
        for engine, integrator in chosen.items()
        if integrator is not None
    ]


def trained(data: Mapping[str, Any], of: Discretization) -> tuple[Home, ...]:
    """Training discretizations and mixtures, in order.

    Args:
        data: of the specification.
        of: what has their control period, and the engine of those that name none.
    """
    found: list[Home] = []
    for entry in list_of(data, "train"):
        if isinstance(entry, Mapping) and "mixture" in entry:
            found.append(_mixture(entry, of))
        else:
            found += [member for member, _ in _expand("train", entry, of)]
    return tuple(dict.fromkeys(found))


def evaluated(data: Mapping[str, Any], of: Discretization) -> tuple[Discretization, ...]:
    """Discretizations of the grid, in order; on every installed engine where it asks for that.

    Args:
        data: of the specification.
        of: see :func:`trained`.

    Raises:
        SpecError: if it asks for installed engines, and there is none.
    """
    entries: list[Any] = []
    for entry in list_of(data, "evaluate"):
        entries += on_installed(entry) if asks_for_installed(entry) else [entry]
    found = [member for entry in entries for member, _ in _expand("evaluate", entry, of)]
    asked = [entry["map"] for entry in list_of(data, "evaluate") if asks_for_installed(entry)]
    if asked:
        check_some_installed(found, [name for maps in asked for name in many(maps)])
    return tuple(dict.fromkeys(found))


def asks_for_installed(entry: Any) -> bool:
    """Whether a table of `evaluate` is for every installed engine."""
    return isinstance(entry, Mapping) and entry.get("engine") == INSTALLED


def _mixture(entry: Mapping[str, Any], of: Discretization) -> DiscretizationMixture:
    """A table with a name and ``members``, whose weights hold for each that they expand to."""
    check_keys("key of a mixture in `train`", entry, ("mixture", "members"))
    name = text("mixture", entry["mixture"])
    members = [
        expanded
        for member in list_of(entry, "members")
        for expanded in _expand(f"members of {name}", member, of, (WEIGHT,))
    ]
    if len(members) < 2:
        raise SpecError(
            f"mixture {name!r} needs at least two `members`, got {len(members)}; a single "
            "discretization is trained on without a mixture"
        )
    check_unique(f"members of {name}", [member.name for member, _ in members])
    return DiscretizationMixture(name, tuple(members))


def _expand(
    key: str, entry: Any, of: Discretization, more: tuple[str, ...] = ()
) -> list[tuple[Discretization, float]]:
    """Discretizations of a table in which integrator and dt may be lists, with their weight."""
    if not isinstance(entry, Mapping):
        raise SpecError(
            f"every entry of `{key}` must be a table with `integrator` and `dt`, got {entry!r}"
        )
    check_keys(f"key in `{key}`", entry, ("integrator", "dt", "engine", *more))
    if "integrator" not in entry or "dt" not in entry:
        raise SpecError(f"every entry of `{key}` needs `integrator` and `dt`")
    engine = text("engine", entry.get("engine", of.engine))
    weight = positive(WEIGHT, entry.get(WEIGHT, 1.0))
    return [
        (
            replace(
                of, integrator=text("integrator", integrator), dt=positive("dt", dt), engine=engine
            ),
            weight,
        )
        for integrator in many(entry["integrator"])
        for dt in many(entry["dt"])
    ]


def standard_perturbations(setup: Any) -> tuple[Perturbation, ...]:
    """A heavier plant and a later command, of an environment that can have them.

    Args:
        setup: of its undisturbed cell.
    """
    found, arguments = [], setup.arguments()
    if "mass" in arguments:
        found.append(Perturbation("mass +20 %", {"mass": 1.2 * arguments["mass"]}))
    if "action_latency" in arguments:
        period = setup.timing.control_period
        later = arguments["action_latency"] + period
        found.append(Perturbation(f"latency +{1000.0 * period:g} ms", {"action_latency": later}))
    return tuple(found)


def perturbations_of(data: Mapping[str, Any], setup: Any) -> tuple[Perturbation, ...]:
    """Those given; where the key is left out, those of every panel."""
    if "perturbations" in data:
        return tuple(_perturbation(entry) for entry in list_of(data, "perturbations"))
    return standard_perturbations(setup)


def _perturbation(entry: Any) -> Perturbation:
    if not isinstance(entry, Mapping) or not isinstance(entry.get("environment", {}), Mapping):
        raise SpecError(
            f"every perturbation must be a table with a `name` and a table `environment`, got "
            f"{entry!r}"
        )
    check_keys("key in `perturbations`", entry, ("name", "environment"))
    if not entry.get("name") or not entry.get("environment"):
        raise SpecError("every perturbation needs a `name` and an `environment` table")
    return Perturbation(str(entry["name"]), dict(entry["environment"]))


@dataclass(frozen=True)
class Sweep:
    """A constructor argument, the values that it takes, ascending, and their unit."""

    argument: str
    values: tuple[float, ...]
    unit: str

    def perturbations(self, nominal: Any) -> tuple[Perturbation, ...]:
        """One for each value but the undisturbed one, whose cells there are already.

        Args:
            nominal: setup of the undisturbed task.
        """
        own = float(nominal.arguments()[self.argument] or 0.0)
        return tuple(
            Perturbation(swept_name(self.argument, value), {self.argument: value})
            for value in self.values
            if not math.isclose(value, own, rel_tol=1e-12)
        )


def swept_name(argument: str, value: float) -> str:
    """What a value's perturbation is called."""
    return f"{argument}={value:g}"


def sweeps_of(data: Mapping[str, Any], nominal: Any) -> tuple[Sweep, ...]:
    """The tables under ``sweep``.

    Raises:
        SpecError: for an argument that the environment lacks, that holds no number, that cells
            vary, or for less than two values.
    """
    ours = is_integ_environment(str(data.get("env_id")))
    found = tuple(_sweep(entry, nominal, ours) for entry in list_of(data, "sweep"))
    check_unique("sweep", [sweep.argument for sweep in found])
    return found


def _sweep(entry: Any, nominal: Any, ours: bool) -> Sweep:
    if not isinstance(entry, Mapping) or set(entry) != {"argument", "values"}:
        if isinstance(entry, Mapping):
            check_keys("key in `sweep`", entry, ("argument", "values"))
        raise SpecError(f"every sweep must be a table with `argument` and `values`, got {entry!r}")
    argument, arguments = text("argument", entry["argument"]), nominal.arguments()
    if argument in DISCRETIZATION:
        raise SpecError(f"`sweep` of `{argument}`, which is what cells vary; use `evaluate` for it")
    if not ours and not _is_number(arguments.get(argument)):
        raise SpecError(
            f"`sweep` of `{argument}`, whose number the environment does not tell; state the value "
            "that it has otherwise under `environment`"
        )
    numbers = [n for n, x in arguments.items() if _is_number(x) or x is None]
    check_known("argument in `sweep`", argument, [n for n in numbers if n not in DISCRETIZATION])
    values = list_of(entry, "values")
    if len(values) < 2 or not all(map(_is_number, values)):
        raise SpecError(f"`values` of the sweep of `{argument}` must be two numbers or more")
    check_unique(f"values of the sweep of {argument}", values)
    unit = nominal.units().get(argument, "")
    return Sweep(argument, tuple(sorted(float(value) for value in values)), unit)


def _is_number(value: Any) -> bool:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return is_number and math.isfinite(value)
