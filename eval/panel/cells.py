"""Cells of a panel: discretizations, mixtures, perturbations and sweeps, read from tables."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

import msgspec

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
from integ_gym.support.errors import IntegGymError
from integ_gym.support.isolated import ISOLATED
from integ_gym.support.optional import install_command, running_version
from integ_gym.support.parameters import unknown_name

from ..statistics import Part
from ..verdict import Achievability, Attempt, CellRole, Search


class SpecError(IntegGymError, ValueError):
    """A specification that cannot be run, in one sentence with the remedy."""


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


T = TypeVar("T")


def convert(place: str, value: Any, kind: type[T]) -> T:
    """Plain data of a specification as what it must be.

    Raises:
        SpecError: saying what was expected where, and what came.
    """
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        found, _, path = str(error).partition(" - at `$")
        for word, plain in (("Object ", "Table "), ("`object`", "`table`"), ("array", "list")):
            found = found.replace(word, plain)
        at = (place + path.rstrip("`")).lstrip(".")
        where = f" - at `{at}`" if at else ""
        raise SpecError(f"{found}{where}; docs/reference/panel.md has the format") from None


Name: TypeAlias = Annotated[str, msgspec.Meta(min_length=1)]
Positive: TypeAlias = Annotated[float, msgspec.Meta(gt=0.0, le=sys.float_info.max)]
Count: TypeAlias = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]
_Finite: TypeAlias = Annotated[float, msgspec.Meta(ge=-sys.float_info.max, le=sys.float_info.max)]


class Places(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of `train` or `evaluate`: every integrator at every step.

    Attributes:
        dt: integration step or steps, s.
        integrator: integrator or integrators, as the engine calls them.
        engine: what advances the plant; None: as at home. `installed`: every installed one.
        map: in place of `integrator` for all installed engines: names of one-step maps, the
            preferred one first.
        weight: of each member of a mixture.
    """

    dt: Positive | list[Positive]
    integrator: Name | list[Name] | None = None
    engine: Name | None = None
    map: Name | list[Name] | None = None
    weight: Positive | None = None

    def discretizations(self, home: Discretization) -> list[Discretization]:
        """Every integrator at every step; on every installed engine where it asks for these."""
        chosen = [(self.engine or home.engine, name) for name in many(self.integrator or [])]
        if self.engine == INSTALLED:
            maps = many(self.map)
            found = ((engine, integrator_applying(engine, maps)) for engine in installed_engines())
            chosen = [(engine, integrator) for engine, integrator in found if integrator]
        return [
            replace(home, engine=engine, integrator=integrator, dt=dt)
            for engine, integrator in chosen
            for dt in many(self.dt)
        ]


class MixtureTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of `train` with a name, and members whose weight holds for each discretization.

    Attributes:
        mixture: name.
        members: what training episodes draw from.
    """

    mixture: Name
    members: list[Places]


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


class Perturbation(Part, frozen=True):
    """A change of the plant or its delays, on the home and reference cells.

    Attributes:
        name: name of the change, unique.
        environment: constructor arguments of the environment that differ from the panel's.
    """

    name: Name
    environment: Annotated[Mapping[str, Any], msgspec.Meta(min_length=1)]


CellKind: TypeAlias = Literal["grid", "reference", "perturbation", "ladder"]
"""Of the grid; the truth; with a changed plant or delay; the control period follows the step."""


class AppliedDiscretization(Part, frozen=True, kw_only=True):
    """What the environments of a cell really did, read back from those that were made.

    Attributes:
        engine: what advanced the plant.
        engine_version: its version; null where it tells none.
        integrator: integrator, as the engine calls it.
        dt: integration step, s.
        substeps: integration steps in a control period.
        control_period: time between two decisions, s.
    """

    engine: str
    engine_version: str | None
    integrator: str
    dt: float
    substeps: int
    control_period: float


class Cell(Part, frozen=True, kw_only=True):
    """One discretization, perturbed or not, in which policies are evaluated.

    Attributes:
        name: name of the cell, unique.
        engine: `native`, or the simulator that advances the plant.
        integrator: integrator, as the engine calls it.
        dt: integration step, s.
        control_period: time between two decisions, s.
        kind: `grid`, `reference`, `perturbation` or `ladder`.
        perturbation: change of the plant or its delays; null without one.
        role: `reference` or `quarter_step` where the cell decides a comparison of policies.
        applied: what its records tell of the environments; null without records.
        achievability: `achievable`, `too_slow` (within two horizons alone), `unachievable` or
            `undecided`; null where it was not asked.
        best: the attempt that shows this, or that comes nearest; null without one.
        search: the search that rules the goal out; null without one.
    """

    name: str
    engine: str
    integrator: str
    dt: float
    control_period: float
    kind: CellKind
    perturbation: Perturbation | None = None
    role: CellRole | None = None
    applied: AppliedDiscretization | None = None
    achievability: Achievability | None = None
    best: Attempt | None = None
    search: Search | None = None

    @classmethod
    def of(
        cls,
        place: Discretization,
        kind: CellKind,
        perturbation: Perturbation | None = None,
        role: CellRole | None = None,
    ) -> Cell:
        """A cell before anything was evaluated in it."""
        name = f"{place.name} control={place.control_period:g}" if kind == "ladder" else place.name
        return cls(
            name=f"{name}, {perturbation.name}" if perturbation else name,
            **place.arguments(),
            kind=kind,
            perturbation=perturbation,
            role=role,
        )

    @property
    def discretization(self) -> Discretization:
        """Its engine, integrator and steps."""
        return Discretization(self.integrator, self.dt, self.control_period, self.engine)

    @property
    def reference(self) -> bool:
        """Whether this is the truth column."""
        return self.perturbation is None and "reference" in (self.kind, self.role)

    @property
    def scheme(self) -> str:
        """Integrator, and the engine where it is not ours."""
        return self.integrator if self.engine == NATIVE else f"{self.engine} {self.integrator}"

    @property
    def plain(self) -> bool:
        """Whether the plant and its delays are those of the spec."""
        return self.perturbation is None and self.kind != "perturbation"

    def arguments(self, environment: Mapping[str, Any]) -> dict[str, Any]:
        """Constructor arguments of this cell's environment."""
        values = {**environment, **self.discretization.arguments(), **changes_of(self)}
        if self.integrator == "reference":
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
    cell = Cell.of(testbed.truth(control_period) or testbed.home, "grid")
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
        return Cell.of(home, "grid").arguments(environment)
    own = ("engine", "integrator", "dt")
    cells = [(Cell.of(d, "grid").arguments(environment), weight) for d, weight in home.weights]
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


def absent_engines() -> tuple[str, ...]:
    """Names of the engines whose extra is not installed."""
    return tuple(name for name in ENGINES.names() if name != NATIVE and missing_modules(name))


def installed_engines() -> tuple[str, ...]:
    """Names of the installed engines, without the native one."""
    return tuple(name for name in ENGINES.names() if name != NATIVE and not missing_modules(name))


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


def training_homes(entries: Sequence[Mapping[str, Any]], home: Discretization) -> tuple[Home, ...]:
    """Training discretizations and mixtures, in order.

    Args:
        entries: the tables of `train`.
        home: what has their control period, and the engine of those that name none.
    """
    found: list[Home] = []
    for k, entry in enumerate(entries):
        if "mixture" in entry:
            found.append(_mixture(convert(f"train[{k}]", entry, MixtureTable), home))
        else:
            found += _expand("train", convert(f"train[{k}]", entry, Places), home)
    return tuple(dict.fromkeys(found))


def evaluation_grid(entries: Sequence[Places], home: Discretization) -> tuple[Discretization, ...]:
    """Discretizations of the grid, in order; on every installed engine where it asks for that.

    Args:
        entries: the tables of `evaluate`.
        home: see :func:`training_homes`.

    Raises:
        SpecError: if it asks for installed engines, and there is none.
    """
    found = [one for entry in entries for one in _expand("evaluate", entry, home)]
    maps = [name for one in entries if one.engine == INSTALLED for name in many(one.map)]
    if maps and all(one.engine == NATIVE for one in found):
        absent = absent_engines()
        could = [n for n in absent if n not in ISOLATED and integrator_applying(n, maps)]
        name = min(could or [_EASIEST], key=lambda name: name != _EASIEST)
        raise SpecError(
            "it is about other engines, and none that it could use is installed; run: "
            f"{install_command(name)}, or see `integ-gym engines` for the others"
        )
    return tuple(dict.fromkeys(found))


def _expand(key: str, entry: Places, home: Discretization) -> list[Discretization]:
    """The discretizations of a table that says all that it must, and no more."""
    if entry.engine == INSTALLED and key == "evaluate":
        if entry.integrator is not None or entry.map is None:
            raise SpecError(
                f'engine "{INSTALLED}" takes `map` in place of `integrator`, for engines call '
                f"their integrators differently; known maps: {', '.join(map_names())}"
            )
        for name in many(entry.map):
            check_known("map in `evaluate`", name, map_names())
    elif entry.integrator is None or entry.map is not None:
        raise SpecError(f"every entry of `{key}` needs `integrator` and `dt`, and no `map`")
    if entry.weight is not None and key in ("train", "evaluate"):
        raise SpecError(f"`{WEIGHT}` in `{key}` is for members of a mixture; leave it out")
    return entry.discretizations(home)


def _mixture(table: MixtureTable, home: Discretization) -> DiscretizationMixture:
    label = f"members of {table.mixture}"
    members = [
        (one, 1.0 if entry.weight is None else entry.weight)
        for entry in table.members
        for one in _expand(label, entry, home)
    ]
    if len(members) < 2:
        raise SpecError(
            f"mixture {table.mixture!r} needs at least two `members`, got {len(members)}; a single "
            "discretization is trained on without a mixture"
        )
    check_unique(label, [member.name for member, _ in members])
    return DiscretizationMixture(table.mixture, tuple(members))


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


class SweepTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of `sweep`.

    Attributes:
        argument: constructor argument of the environment.
        values: what it takes, two numbers or more.
    """

    argument: Name
    values: Annotated[list[_Finite], msgspec.Meta(min_length=2)]


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


def sweeps_of(env_id: str, entries: Sequence[SweepTable], nominal: Any) -> tuple[Sweep, ...]:
    """The tables under ``sweep``.

    Args:
        env_id: of the panel.
        entries: the tables.
        nominal: setup of the undisturbed task.

    Raises:
        SpecError: for an argument that the environment lacks, that holds no number or that cells
            vary.
    """
    arguments, ours = nominal.arguments(), is_integ_environment(env_id)
    check_unique("sweep", [entry.argument for entry in entries])
    numbers = [n for n, x in arguments.items() if _is_number(x) or x is None]
    for entry in entries:
        name = entry.argument
        if name in DISCRETIZATION:
            raise SpecError(f"`sweep` of `{name}`, which is what cells vary; use `evaluate` for it")
        if not ours and not _is_number(arguments.get(name)):
            raise SpecError(
                f"`sweep` of `{name}`, whose number the environment does not tell; state the value "
                "that it has otherwise under `environment`"
            )
        check_known("argument in `sweep`", name, [n for n in numbers if n not in DISCRETIZATION])
        check_unique(f"values of the sweep of {name}", entry.values)
    units = nominal.units()
    return tuple(
        Sweep(entry.argument, tuple(sorted(entry.values)), units.get(entry.argument, ""))
        for entry in entries
    )


def _is_number(value: Any) -> bool:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return is_number and math.isfinite(value)
