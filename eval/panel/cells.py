"""Cells of a panel: anything that can be said of a simulation, read from tables."""

from __future__ import annotations

import json
import math
import re
import sys
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Annotated, Any, Final, Literal, TypeAlias, TypeVar

import msgspec

from integ_gym.envs.engines.maps import map_names
from integ_gym.envs.engines.stepping import (
    absent_engines,
    installed_engines,
    without_idle_solver,
)
from integ_gym.envs.lanes import DiscretizedVectorEnv
from integ_gym.envs.registries import ENGINES, TRUTH
from integ_gym.envs.settings import (
    DELAYS,
    DISCRETIZATION,
    LATENCIES,
    NATIVE,
    STEPPING,
    WEIGHT,
    Discretization,
    Settings,
    agrees,
    dividing_step,
    whole_multiple,
)
from integ_gym.envs.testbeds.gym_testbed import Testbed
from integ_gym.envs.testbeds.making import make_checked
from integ_gym.support.errors import InputError, IntegGymError
from integ_gym.support.interpreters import PACKAGES, parse_packages
from integ_gym.support.isolated import ISOLATED
from integ_gym.support.optional import install_command
from integ_gym.support.parameters import check_values, unknown_name

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
    twice = ", ".join(str(value) for value, count in Counter(values).items() if count > 1)
    if twice:
        raise SpecError(f"`{label}` lists something twice: {twice}; give each once")


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
        found = found.replace("Object ", "Table ").replace("`object`", "`table`")
        found = found.replace("array", "list")
        at = (place + path.rstrip("`")).lstrip(".")
        where = f" - at `{at}`" if at else ""
        raise SpecError(f"{found}{where}; docs/reference/panel.md has the format") from None


Name: TypeAlias = Annotated[str, msgspec.Meta(min_length=1)]
Positive: TypeAlias = Annotated[float, msgspec.Meta(gt=0.0, le=sys.float_info.max)]
Count: TypeAlias = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]
Several: TypeAlias = Annotated[int, msgspec.Meta(ge=1, le=2**32 - 1)]


@dataclass(frozen=True)
class DiscretizationMixture:
    """Discretizations, one of which every training episode draws.

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
    def control_period(self) -> float | None:
        """Time between two decisions, s; None: members have several."""
        first, *others = (member.control_period for member, _ in self.weights)
        return first if all(math.isclose(first, other) for other in others) else None

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


AXIS_OF: Final[Mapping[str, str]] = {
    **dict.fromkeys(STEPPING, "integration"),
    "control_period": "held action",
    **dict.fromkeys((*DELAYS, "fallback"), "delay"),
    **dict.fromkeys(("sensor_period", "observation_noise"), "sensing"),
    "solver": "solver",
    PACKAGES: "version",
}
"""What a constructor argument in which a cell differs from home is part of; others: the plant."""


class Variation(Part, frozen=True):
    """Arguments that differ from a panel's, and the cells in which they do.

    Attributes:
        name: unique.
        changes: constructor arguments of the environment, those of a discretization among them.
        at: what is varied: `home`, each row's own; `truth`; or discretizations, for every row.
    """

    name: Name
    changes: Annotated[Mapping[str, Any], msgspec.Meta(min_length=1)]
    at: tuple[Literal["home", "truth"] | Discretization, ...] = ("home", "truth")


CellKind: TypeAlias = Literal["grid", "reference", "varied", "ladder", "limit"]
"""Of the grid; the truth; another with some arguments changed; the control period follows dt; a
step of the limit that the grid has not."""


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
    """One simulation in which policies are evaluated.

    Attributes:
        name: name of the cell, unique.
        engine: `native`, or the simulator that advances the plant.
        integrator: integrator, as the engine calls it.
        dt: integration step, s.
        control_period: time between two decisions, s.
        environment: other constructor arguments that differ from the panel's.
        kind: `grid`, `reference`, `varied`, `ladder` or `limit`.
        variation: name of what is varied; null unless the cell is `varied`.
        at: name of the cell that it is varied from; null likewise.
        role: `reference` or `quarter_step` where the cell decides a comparison of policies.
        limit_part: 2, 4 or 8 where it is that part of a home's step from which the limit is
            extrapolated; the limit's column is the cell with 8.
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
    environment: dict[str, Any] = msgspec.field(default_factory=dict)
    kind: CellKind
    variation: str | None = None
    at: str | None = None
    role: CellRole | None = None
    limit_part: Literal[2, 4, 8] | None = None
    applied: AppliedDiscretization | None = None
    achievability: Achievability | None = None
    best: Attempt | None = None
    search: Search | None = None

    @classmethod
    def of(cls, place: Discretization, kind: CellKind, **others: Any) -> Cell:
        """A cell before anything was evaluated in it, by default named as its discretization."""
        return cls(**{"name": place.name, **place.arguments(), "kind": kind, **others})

    @property
    def discretization(self) -> Discretization:
        """Its engine, integrator and steps."""
        return Discretization(self.integrator, self.dt, self.control_period, self.engine)

    @property
    def reference(self) -> bool:
        """Whether this is a truth column."""
        return self.kind == "reference"

    @property
    def column(self) -> bool:
        """Whether every row is evaluated in it for its own sake: of the limit, the finest step."""
        return self.kind in ("grid", "reference") or (self.kind, self.limit_part) == ("limit", 8)

    @property
    def scheme(self) -> str:
        """Integrator, and the engine where it is not ours."""
        return self.integrator if self.engine == NATIVE else f"{self.engine} {self.integrator}"

    @property
    def packages(self) -> tuple[str, ...]:
        """Versions of packages that differ there, as ``"name==version"``."""
        return tuple(self.environment.get(PACKAGES, ()))

    @property
    def changes(self) -> str | None:
        """What is changed beside the discretization, as text that compares; None: nothing."""
        return json.dumps(self.environment, sort_keys=True) if self.environment else None

    def arguments(self, environment: Mapping[str, Any]) -> dict[str, Any]:
        """Constructor arguments of this cell's environment."""
        changes = {name: x for name, x in self.environment.items() if name != PACKAGES}
        return place_arguments(self.discretization, environment, **changes)


def cell_at(cells: Iterable[Cell], control_period: float) -> Cell | None:
    """The first of some cells at a control period, s; None without one."""
    return next((c for c in cells if math.isclose(c.control_period, control_period)), None)


def place_name(place: Discretization, period: float) -> str:
    """Name of a discretization in a panel, with its control period where that is another.

    Args:
        place: the discretization.
        period: of the panel, s.
    """
    own = place.control_period
    return place.name if math.isclose(own, period) else f"{place.name} control={own:g}"


def place_arguments(
    place: Discretization, environment: Mapping[str, Any], **changes: Any
) -> dict[str, Any]:
    """Constructor arguments of an environment in a discretization.

    The reference's step is one that divides delays. Changed settings of a solver come beside the
    environment's, and integrators that have no solver take none.
    """
    values = {**environment, **place.arguments(), **changes}
    if "solver" in changes:
        values["solver"] = {**(environment.get("solver") or {}), **changes["solver"]}
    values = without_idle_solver(values)
    return {**values, "dt": dividing_step(values)} if place.integrator == TRUTH else values


def changes_name(changes: Mapping[str, Any]) -> str:
    """What a variation is called by default: its arguments with their values."""
    words = []
    for path, value in flatten(changes):
        short = f"{value:g}" if isinstance(value, float) else value
        words.append(" ".join(value) if path == PACKAGES else f"{path}={short}")
    return ", ".join(words)


def flatten(changes: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Values by dotted path."""
    for name, value in changes.items():
        if isinstance(value, Mapping):
            yield from ((f"{name}.{path}", one) for path, one in flatten(value))
        else:
            yield name, value


def axes_between(home: Discretization, cell: Cell) -> dict[str, dict[str, Any]]:
    """Arguments that a cell and a home do not share, with the cell's values, by axis.

    The truth's step follows its control period and is no difference of two truths.
    """
    own, exact = home.arguments(), cell.integrator == home.integrator == TRUTH
    found: dict[str, dict[str, Any]] = {}
    for name, value in {**cell.discretization.arguments(), **cell.environment}.items():
        if not ((name in own and agrees({name: value}, own)) or (exact and name == "dt")):
            found.setdefault(AXIS_OF.get(name, "plant"), {})[name] = value
    return found


def timing_fault(arguments: Mapping[str, Any]) -> str | None:
    """What is wrong with the times of an environment's arguments, in words; None: nothing."""
    try:
        check_values(Settings, {"dt": arguments["dt"]})
        for name in ("control_period", *LATENCIES, "sensor_period"):
            if arguments.get(name):
                whole_multiple(name, arguments[name], "dt", arguments["dt"])
    except InputError as error:
        return str(error)
    return None


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


def setup_of(testbed: Testbed, cell: Cell) -> Any:
    """The setup of a cell's environments.

    Raises:
        TypeError, ValueError: for a cell that cannot be made.
    """
    environments = environments_of(testbed, cell, 1)
    environments.close()
    return environments.setups[0]


@lru_cache(maxsize=16)
def nominal_setup(testbed: Testbed, control_period: float) -> Any:
    """The setup of the undisturbed task on its truth, or at home where there is none.

    Baselines are designed from its parameters.
    """
    return setup_of(testbed, Cell.of(testbed.truth(control_period) or testbed.home, "grid"))


def training_arguments(home: Home, environment: Mapping[str, Any]) -> dict[str, Any]:
    """Constructor arguments of a training environment.

    Args:
        home: what is trained on.
        environment: arguments common to all discretizations.
    """
    if isinstance(home, Discretization):
        return place_arguments(home, environment)
    own = STEPPING if home.control_period else DISCRETIZATION
    members = [(place_arguments(d, environment), weight) for d, weight in home.weights]
    mixture = [{**{name: a[name] for name in own}, WEIGHT: weight} for a, weight in members]
    common = {name: value for name, value in members[0][0].items() if name not in own}
    return {**common, "mixture": mixture}


def file_name(row: str) -> str:
    """A row's name as that of its files."""
    return re.sub(r"[^A-Za-z0-9._]+", "-", row)


class Places(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of `train` or `evaluate`: every integrator at every step and control period.

    Attributes:
        dt: integration step or steps, s.
        integrator: integrator or integrators, as the engine calls them.
        engine: what advances the plant; None: as at home. `installed`: every installed one.
        control_period: time or times between two decisions, s; None: the panel's.
        map: in place of `integrator` for all installed engines: names of one-step maps, the
            preferred one first.
    """

    dt: Positive | list[Positive]
    integrator: Name | list[Name] | None = None
    engine: Name | None = None
    control_period: Positive | list[Positive] | None = None
    map: Name | list[Name] | None = None

    def discretizations(self, key: str, home: Discretization) -> list[Discretization]:
        """Every combination, possible or not; on every installed engine where it asks for these.

        Args:
            key: of the table.
            home: what has their control period, and the engine of those that name none.

        Raises:
            SpecError: if it does not say all that it must, or more.
        """
        chosen = [(self.engine or home.engine, name) for name in many(self.integrator or [])]
        if self.engine == INSTALLED and key == "evaluate":
            if self.integrator is not None or self.map is None:
                raise SpecError(
                    f'engine "{INSTALLED}" takes `map` in place of `integrator`, because '
                    f"engines name integrators differently; known maps: {', '.join(map_names())}"
                )
            for name in many(self.map):
                check_known("map in `evaluate`", name, map_names())
            found = [(one, self.applied_by(one)) for one in installed_engines() if one != NATIVE]
            chosen = [(engine, integrator) for engine, integrator in found if integrator]
        elif self.integrator is None or self.map is not None:
            raise SpecError(f"every entry of `{key}` needs `integrator` and `dt`, and no `map`")
        return [
            replace(home, engine=engine, integrator=integrator, dt=dt, control_period=period)
            for engine, integrator in chosen
            for period in many(self.control_period or home.control_period)
            for dt in many(self.dt)
        ]

    def applied_by(self, engine: str) -> str | None:
        """An engine's own name for the first of the maps that it applies, None without one."""
        own = ENGINES.load(engine).maps
        return next((name for map in many(self.map) for name in own if own[name] == map), None)


class Member(Places, frozen=True):
    """A table of a mixture's `members`.

    Attributes:
        weight: of each discretization of it.
    """

    weight: Positive = 1.0


class MixtureTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of `train` with a name.

    Attributes:
        mixture: name.
        members: what training episodes draw from.
    """

    mixture: Name
    members: list[Member]

    def build(self, home: Discretization) -> DiscretizationMixture:
        """The mixture; see :meth:`Places.discretizations`."""
        label = f"members of {self.mixture}"
        members = [(d, x.weight) for x in self.members for d in x.discretizations(label, home)]
        if len(members) < 2:
            raise SpecError(
                f"mixture {self.mixture!r} needs at least two `members`, got {len(members)}; a "
                "single discretization is trained on without a mixture"
            )
        check_unique(label, [place_name(one, home.control_period) for one, _ in members])
        return DiscretizationMixture(self.mixture, tuple(members))


INSTALLED = "installed"
"""In place of an engine's name: every installed one but the native."""


def training_homes(entries: Sequence[Mapping[str, Any]], home: Discretization) -> tuple[Home, ...]:
    """Training discretizations and mixtures, in order.

    Args:
        entries: the tables of `train`.
        home: what has their control period, and the engine of those that name none.
    """
    found: list[Home] = []
    for k, entry in enumerate(entries):
        if "mixture" in entry:
            found.append(convert(f"train[{k}]", entry, MixtureTable).build(home))
        else:
            found += convert(f"train[{k}]", entry, Places).discretizations("train", home)
    return tuple(dict.fromkeys(found))


def evaluation_cells(
    entries: Sequence[Mapping[str, Any]], home: Discretization
) -> tuple[tuple[Discretization, ...], tuple[Variation, ...], tuple[str, ...]]:
    """What the tables of `evaluate` ask for: discretizations of the grid, and variations.

    A table's lists are expanded. Combinations of a step and a control period that is no multiple
    of it are left out, and so are engines that are not installed, which sentences say.

    With `integrator` and `dt` alone a table is of the grid; with any other argument of the
    environment it varies these discretizations, and with `at` what that names.

    Args:
        entries: the tables of `evaluate`.
        home: see :func:`training_homes`.

    Raises:
        SpecError: for a table of neither form, or if it asks for installed engines, and there is
            none.
    """
    grid: list[Discretization] = []
    variations: dict[str, Variation] = {}
    installed: list[Places] = []
    unmade: list[str] = []
    for k, entry in enumerate(entries):
        where, rest, places = f"evaluate[{k}]", dict(entry), list[Any]()
        name, at = rest.pop("name", None), rest.pop("at", None)
        if at is None and {"integrator", "map", "dt", "engine"} & set(rest):
            own = {key: rest.pop(key) for key in Places.__struct_fields__ if key in rest}
            table = convert(where, own, Places)
            installed += [table] if table.engine == INSTALLED else []
            places = table.discretizations("evaluate", home)
            places, faults = fitting(places, [place.dt for place in places])
            unmade += faults
            grid += [] if rest else places
        else:
            named = many(["home", "truth"] if at is None else at)
            for one in convert(f"{where}.at", named, list[Literal["home", "truth"] | Places]):
                places += one.discretizations("at", home) if isinstance(one, Places) else [one]
        if not rest and (name is not None or at is not None or not entry):
            raise SpecError(f"{where} varies nothing; give arguments, or no `at` and no `name`")
        if rest:
            name = None if name is None else convert(where, name, Name)
            for new in vary(name, rest, tuple(places)):
                known = variations.setdefault(repr((new.name, new.changes)), new)
                at = tuple(dict.fromkeys((*known.at, *new.at)))
                variations[repr((new.name, new.changes))] = Variation(new.name, new.changes, at)
    if installed and all(one.engine == NATIVE for one in grid):
        could = [name for name in absent_engines() if name not in ISOLATED]
        could = [name for name in could if any(table.applied_by(name) for table in installed)]
        easiest = "mujoco" if "mujoco" in could or not could else could[0]
        raise SpecError(
            "it compares other engines, and none that it could use is installed; run: "
            f"{install_command(easiest)}, or see `integ-gym engines` for the others"
        )
    if installed:
        unmade += [
            f"Engine {name} is not installed, so it is left out: {install_command(name)}."
            for name in absent_engines()
        ]
    return tuple(dict.fromkeys(grid)), tuple(variations.values()), tuple(unmade)


def fitting(
    places: Iterable[Discretization], steps: Collection[float] = ()
) -> tuple[list[Discretization], list[str]]:
    """Discretizations whose control period is a multiple of their step; sentences on the others.

    Args:
        places: to choose from.
        steps: that were asked for, s.

    Raises:
        SpecError: if nothing is left, or nothing with one of these steps.
    """
    faults = {place: timing_fault(place.arguments()) for place in places}
    fit = [place for place, fault in faults.items() if not fault]
    wrong = {place: fault for place, fault in faults.items() if fault}
    for place, fault in wrong.items():
        if not fit or (place.dt in steps and place.dt not in {one.dt for one in fit}):
            raise SpecError(fault)
    return fit, [
        f"{place.name} is not evaluated at a control period of {place.control_period:g} s: {fault}."
        for place, fault in wrong.items()
    ]


def vary(name: str | None, table: Mapping[str, Any], at: tuple[Any, ...]) -> Iterator[Variation]:
    """Every combination of a table's lists, named by its values where it has no other name."""
    combinations = expand(table)
    for changes in combinations:
        values = changes_name(changes)
        own = values if name is None else name if len(combinations) == 1 else f"{name}, {values}"
        yield Variation(own, changes, at)


def expand(table: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Every combination of the values in a table's lists, those of tables in it among them.

    The value of `packages` is a list itself, and a list of such lists is expanded.

    Raises:
        ValueError: for `packages` that are no exact versions.
    """
    choices = (_choices(name, value) for name, value in table.items())
    return [dict(zip(table, chosen, strict=True)) for chosen in product(*choices)]


def _choices(name: str, value: Any) -> list[Any]:
    if name != PACKAGES:
        return expand(value) if isinstance(value, Mapping) else many(value)
    listed = many(value)
    several = bool(listed) and all(isinstance(one, list) for one in listed)
    return [list(parse_packages(one)) for one in (listed if several else [listed])]


def standard_variations(setup: Any) -> tuple[Variation, ...]:
    """A heavier plant and a later command, of an environment that can have them.

    Args:
        setup: of its undisturbed cell.
    """
    found, arguments = [], setup.arguments()
    if "mass" in arguments:
        found.append(Variation("mass +20 %", {"mass": 1.2 * arguments["mass"]}))
    if "action_latency" in arguments:
        period = setup.timing.control_period
        later = arguments["action_latency"] + period
        found.append(Variation(f"latency +{1000.0 * period:g} ms", {"action_latency": later}))
    return tuple(found)
