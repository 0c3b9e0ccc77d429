"""The specification of a panel: read from TOML, checked, expanded into rows and cells."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import msgspec

from integ_gym.envs.engines.stepping import engine_versions, has_solver
from integ_gym.envs.registries import INTEGRATORS, TRUTH
from integ_gym.envs.settings import DISCRETIZATION, WEIGHT, Discretization
from integ_gym.envs.testbeds.gym_testbed import Testbed
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.evidence.schema import published_text, schema_head
from integ_gym.support.errors import InputError
from integ_gym.support.files import read_bounded
from integ_gym.support.optional import package_version
from integ_gym.train.baselines import BASELINES, possible_baselines
from integ_gym.train.runs import ALGORITHMS, Algorithm

from ..verdict import MIN_SEEDS, CellRole
from .cells import (
    AXIS_OF,
    Cell,
    CellKind,
    Count,
    DiscretizationMixture,
    Home,
    Name,
    Positive,
    Several,
    SpecError,
    Variation,
    axes_between,
    changes_name,
    check_known,
    check_unique,
    convert,
    evaluation_cells,
    file_name,
    many,
    nominal_setup,
    place_name,
    setup_of,
    standard_variations,
    timing_fault,
    training_homes,
)
from .limit import PARTS, choose_steps

TRAINERS = {"fleet": ("jax",), "sb3": ("stable-baselines3", "torch")}
"""What trains policies, with the packages that these depend on beside those of every run."""

STARTS_APART = 10_000
"""Seeds between the first starts of one training seed and of the next."""

START_SETS = 5
"""Seeds, from the first training seed on, whose starts a hand-made controller acts from."""

ALGORITHM = "algorithm"
"""Key in ``training`` that is no hyperparameter but says whose they are."""

DEFAULT_ALGORITHM = next(iter(ALGORITHMS))
"""What learns where nothing is said; the fleet trains by it alone."""

NO_RESULT = ("memory_gib",)
"""Attributes that change no result."""

LATER = ("episode_parts", "looks", "unmade", "limit", "check")
"""Attributes that are written only where they say something; older specifications lack them."""


@dataclass(frozen=True, kw_only=True)
class Stated:
    """What a panel is as its file states it; see docs/reference/panel.md."""

    name: Name
    question: Name = "Does a policy trained on one integrator and timestep survive another?"
    env_id: Name
    control_period: Positive
    environment: Mapping[str, Any] = field(default_factory=dict)
    training: Mapping[str, Any] = field(default_factory=dict)
    trainer: Name = "fleet"
    """`fleet` (compiled; all policies at once) or `sb3` (stable-baselines3)."""
    seeds: tuple[Count, ...]
    exploratory_seeds: Several | None = None
    """How many of the seeds rows are trained with that no declared comparison names; all."""
    family: tuple[tuple[str, str], ...] = ()
    """Declared comparisons: (training discretization or mixture, cell)."""
    compare: tuple[tuple[str, str], ...] = ()
    """Pairs of the same whose policies are compared under refinement."""
    looks: tuple[Count, ...] = ()
    """Seeds at the planned looks at verdicts, which share the level; empty: none is planned."""
    ladder: bool = True
    """Also refine each policy's own discretization with the control period following dt."""
    episode_seed: Count = 1000
    trace_every: Several = 1
    """Every so many-th episode of a policy in a cell has a trace; all can be replayed."""
    memory_gib: Positive | None = None
    """What the fleet's processes may take together, GiB."""


@dataclass(frozen=True, kw_only=True)
class PanelSpec(Stated):
    """One panel."""

    train: tuple[Home, ...]
    grid: tuple[Discretization, ...]
    baselines: tuple[Name, ...] = ()
    """Policies without training that the rows are held against."""
    variations: tuple[Variation, ...] = ()
    """Arguments that differ in other cells than those of the grid."""
    limit: tuple[Mapping[str, Any], ...] = ()
    """Constructor arguments of the steps that the limit is extrapolated from; empty: no limit."""
    episodes: Several = 20
    """Starts of every seed."""
    episode_parts: tuple[Count, ...] = ()
    """How many of them came at a time, in order, where they did not come all at once."""
    unmade: tuple[Name, ...] = ()
    """What was asked for and cannot be, in sentences."""
    check: bool = False
    """Whether seeds are added until the interval of the loss is narrow; see `eval.loss_check`."""

    @property
    def testbed(self) -> Testbed:
        """What makes the environments."""
        return find_testbed(self.env_id, self.environment)

    @property
    def nominal(self) -> Any:
        """The setup of the undisturbed task; see `nominal_setup`."""
        return nominal_setup(self.testbed, self.control_period)

    @property
    def reference(self) -> Discretization | None:
        """The truth column: the plant solved to rounding under the same zero-order hold."""
        return self.testbed.truth(self.control_period)

    @property
    def latest(self) -> range:
        """Episodes that came last: all, where they came at once."""
        return range(self.episodes - (self.episode_parts or (self.episodes,))[-1], self.episodes)

    def parts(self) -> tuple[PanelSpec, ...]:
        """The panel with the episodes that came first, with those after them, and whole.

        How many starts a network answers at once shows in the last bits of its actions, so what is
        evaluated is what is :attr:`latest` in one of these, and depends on nothing that came later.
        """
        first = [self.episode_parts[:count] for count in range(1, len(self.episode_parts))]
        before = [(sum(parts), parts if len(parts) > 1 else ()) for parts in first]
        return (*(replace(self, episodes=n, episode_parts=parts) for n, parts in before), self)

    def start_seed(self, starts: int, episode: int) -> int:
        """Seed of a start, the same in every cell.

        Args:
            starts: training seed of the policy; every seed has starts of its own.
            episode: place among them.
        """
        return self.episode_seed + STARTS_APART * starts + episode

    def attempt(self, place: int, episode: int) -> int:
        """Number of a hand-made controller's attempt: from which of the sets' starts, and which."""
        return episode * len(self.start_sets) + place

    @property
    def twice_the_time(self) -> dict[str, float] | None:
        """Constructor argument of a second horizon; None where the testbed's horizon is fixed."""
        name = self.testbed.horizon
        return None if name is None else {name: 2.0 * self.nominal.settings.duration}

    def name_of(self, home: Home) -> str:
        """Name of a row, and of the cell that is a row's home."""
        if isinstance(home, DiscretizationMixture):
            return home.name
        return place_name(home, self.control_period)

    def shares_of(self, home: Home | None) -> dict[str, float]:
        """Share of each cell that training draws from; empty where that is not known."""
        return {} if home is None else {self.name_of(d): x for d, x in home.shares.items()}

    def seeds_of(self, home: Home) -> tuple[int, ...]:
        """Training seeds of a row: all, or the first of them where nothing declared names it."""
        named = {row for row, _ in self.family}
        return self.seeds if self.name_of(home) in named else self.seeds[: self.exploratory_seeds]

    @property
    def start_sets(self) -> tuple[int, ...]:
        """Seeds whose starts a hand-made controller tries; baselines have the first's.

        They do not depend on how many training seeds there are, so that more may be added.
        """
        return tuple(range(self.seeds[0], self.seeds[0] + START_SETS)) if self.seeds else (0,)

    def columns(self) -> tuple[Cell, ...]:
        """Cells that every row is evaluated in: the grid, the truth and the limit.

        The latter two at each control period, the limit as its finest step.
        """
        periods = dict.fromkeys((self.control_period, *(d.control_period for d in self.grid)))
        truths = [truth for truth in map(self.testbed.truth, periods) if truth is not None]
        limit = tuple(self._limit_cells())
        parts = {cell.discretization: cell.limit_part for cell in limit if not cell.changes}
        kinds: dict[Discretization, CellKind] = {d: "grid" for d in self.grid if d not in truths}
        cells = [
            self._cell(place, kind, role=self._role(place, kind), limit_part=parts.get(place))
            for place, kind in (kinds | dict.fromkeys(truths, "reference")).items()
        ]
        return _each_once(*cells, *(cell for cell in limit if cell.limit_part == PARTS[-1]))

    def _limit_cells(self) -> Iterator[Cell]:
        """The limit's steps, each by itself."""
        for arguments in self.limit:
            changes = {name: arguments[name] for name in ("solver",) if name in arguments}
            place = Discretization(**{name: arguments[name] for name in DISCRETIZATION})
            name, part = self.name_of(place) + ", tight solver" * bool(changes), arguments["part"]
            yield self._cell(place, "limit", name=name, environment=changes, limit_part=part)

    def _cell(self, place: Discretization, kind: CellKind, **others: Any) -> Cell:
        return Cell.of(place, kind, **{"name": self.name_of(place), **others})

    def trained_on(self) -> tuple[Discretization, ...]:
        """All discretizations that something is trained on."""
        return tuple(dict.fromkeys(d for home in self.train for d in home.shares))

    def _role(self, place: Discretization, kind: CellKind) -> CellRole | None:
        """Of the truth, and of an integrator's finest step, a quarter of what it was trained at."""
        if kind == "reference":
            return "reference" if place == self.reference else None
        dts = [d.dt for d in self.grid if d.scheme == place.scheme]
        homes = [d.dt for d in self.trained_on() if d.scheme == place.scheme]
        coarsest = max(homes, default=place.control_period)
        return "quarter_step" if place.dt <= min(*dts, coarsest * (1.0 + 1e-9) / 4.0) else None

    def gaps(self) -> list[str]:
        """What every panel has and this one lacks, in sentences."""
        found = []
        if self.reference is None:
            stand_in = "the limit" if self.limit else "each other"
            found.append(
                f"{self.env_id} has no reference solution: its cells are held against the home and "
                f"against {stand_in}, not against the truth."
            )
        found += [f"There is no baseline {b!r}." for b in BASELINES if b not in self.baselines]
        changed = {name for one in self.variations for name in one.changes}
        if all(name in AXIS_OF for name in changed):
            found.append("No perturbation of the plant is evaluated.")
        if "action_latency" not in changed:
            found.append("No action latency is evaluated.")
        varied = self.varied(self.trained_on())
        lacking = (f"There is no cell {x.name!r}: {fault}." for x, fault in varied if x and fault)
        found += [*self.unmade, *dict.fromkeys(lacking)]
        setup = self.nominal
        if setup.settings.duration < setup.task.goal_stay:
            found.append(
                f"Episodes last {setup.settings.duration:g} s, but success takes "
                f"{setup.task.goal_stay:g} s at the goal: no episode can succeed."
            )
        return found

    def cells_of(self, home: Home | None) -> tuple[Cell, ...]:
        """Cells of one row: columns, those that it was trained in first, the limit's other steps,
        what varies, its ladder.

        Of a cell that differs from a home in several axes, also those in which one of them alone is
        changed, and all but one.
        """
        own = () if home is None else tuple(home.shares)
        columns = sorted(self.columns(), key=lambda cell: cell.discretization not in own)
        varied = [cell for cell, fault in self.varied(own) if cell and not fault]
        separated = self._separated(home, varied) if isinstance(home, Discretization) else ()
        return _each_once(*columns, *self._limit_cells(), *varied, *separated, *self._ladder(home))

    def cells_by_name(self, homes: Iterable[Home | None]) -> dict[str, Cell]:
        """Cells of rows with these homes, by name."""
        return {cell.name: cell for home in homes for cell in self.cells_of(home)}

    def varied(self, own: Sequence[Discretization]) -> Iterator[tuple[Cell | None, str | None]]:
        """Cells of variations, each with what is wrong with it, if anything."""
        truths = tuple(map(self.testbed.truth, (d.control_period for d in own)))
        named: dict[Any, Sequence[Any]] = {"home": own, "truth": truths or (self.reference,)}
        for variation, at in ((one, at) for one in self.variations for at in one.at):
            for place in filter(None, dict.fromkeys(named.get(at, (at,)))):
                solves = has_solver(place.engine, place.integrator)
                if {*variation.changes} == {"solver"} and not solves:
                    fault = f"{place.integrator} has no solver; choose an integrator that "
                    yield None, fault + "`integ-gym engines` lists with one"
                elif cell := self._vary(place, variation, stated=place is at):
                    yield cell, timing_fault(cell.arguments(self.environment))

    def _vary(
        self, place: Discretization, variation: Variation, stated: bool = False
    ) -> Cell | None:
        """A discretization with a variation's changes; None where it changes nothing.

        Of the truth's discretization the control period alone can be another. One that a table
        states is a cell of its own where nothing changes in it.
        """
        nominal = self.nominal.arguments()
        arguments = {**place.arguments(), **variation.changes}
        there = Discretization(**{name: arguments.pop(name) for name in DISCRETIZATION})
        changes = {k: x for k, x in arguments.items() if not _is_same(nominal.get(k), x)}
        if place == self.testbed.truth(place.control_period):
            if there != replace(place, control_period=there.control_period):
                return None
            there = self.testbed.truth(there.control_period) or there
        if not has_solver(there.engine, there.integrator):
            changes.pop("solver", None)
        if there == place and not changes and not stated:
            return None
        named = variation.name != changes_name(variation.changes)
        name = variation.name if named else changes_name(changes)
        label = self.name_of(there) + (f", {name}" if changes else "")
        varied = {"environment": changes, "variation": variation.name, "at": self.name_of(place)}
        return self._cell(there, "varied", name=label, **varied)

    def _separated(self, home: Discretization, varied: Sequence[Cell]) -> Iterator[Cell]:
        """Cells that tell what each axis in which others differ from home costs alone."""
        for cell in varied:
            axes = axes_between(home, cell)
            if cell.integrator == TRUTH or len(axes) < 2:
                continue
            for axis, alone in axes.items():
                rest = {k: x for name, own in axes.items() if name != axis for k, x in own.items()}
                for changes in (alone, rest):
                    found = self._vary(home, Variation(changes_name(changes), changes))
                    if found and _can_be_made(self.testbed, found.discretization, found.changes):
                        yield found

    def _ladder(self, home: Home | None) -> tuple[Cell, ...]:
        """Of a single discretization whose control period can follow its step."""
        if self.testbed.control_period or not self.ladder or not isinstance(home, Discretization):
            return ()
        finer = (replace(home, dt=dt, control_period=dt) for dt in (home.dt / 2.0, home.dt / 4.0))
        return tuple(self._cell(place, "ladder") for place in finer)

    def engine_versions(self) -> dict[str, str]:
        """Version of the distribution behind each foreign engine that is used."""
        cells = self.cells_by_name((*self.train, None)).values()
        return engine_versions({cell.engine for cell in cells if not cell.packages})

    def to_json(self) -> dict[str, Any]:
        """The specification as plain data, everything resolved.

        `sources` are SHA-256 of the source of every integrator of the user's own.
        """
        silent = (*NO_RESULT, *(name for name in LATER if not getattr(self, name)))
        plan = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in silent}
        plan["train"] = list(map(_table_of, self.train))
        packages = {name: package_version(name) for name in TRAINERS.get(self.trainer, ())}
        used = {d.integrator for d in (*self.trained_on(), *self.grid) if ":" in d.integrator}
        hashes = {name: INTEGRATORS.source_hash(name) for name in sorted(used)}
        plan["trainer"] = {"name": self.trainer, **packages}
        plan["sources"] = {name: digest for name, digest in hashes.items() if digest}
        return dict(json.loads(json.dumps(plan, default=msgspec.to_builtins)))

    @property
    def algorithm(self) -> Algorithm:
        """What learns: PPO where nothing is said."""
        return ALGORITHMS[self.training.get(ALGORITHM, DEFAULT_ALGORITHM)]


@lru_cache(maxsize=1024)
def _can_be_made(testbed: Testbed, place: Discretization, changes: str | None) -> bool:
    """Whether times fit, and the engine has the settings of a solver among :attr:`Cell.changes`."""
    cell = Cell.of(place, "varied", environment=json.loads(changes or "{}"))
    try:
        if "solver" in cell.environment:
            setup_of(testbed, cell)
    except InputError:
        return False
    return timing_fault(cell.arguments(testbed.arguments)) is None


def _is_same(own: Any, value: Any) -> bool:
    """Whether a value is an argument's own; a delay of 0 s is none."""
    if isinstance(own, Mapping) and isinstance(value, Mapping):
        return bool({**own, **value} == own)
    return bool(own == value or (own is None and value == 0))


def _each_once(*cells: Cell) -> tuple[Cell, ...]:
    """Of cells that are one simulation the first."""
    found: dict[Any, Cell] = {}
    for cell in cells:
        found.setdefault((cell.discretization, cell.changes), cell)
    return tuple(found.values())


def _table_of(home: Home) -> dict[str, Any]:
    """What is trained on as a table of `train`."""
    if isinstance(home, Discretization):
        return home.arguments()
    members = [{**member.arguments(), WEIGHT: weight} for member, weight in home.weights]
    return {"mixture": home.name, "members": members}


def check_parts(spec: PanelSpec) -> None:
    """Check a specification.

    Raises:
        SpecError: for parts that contradict each other.
        TypeError, ValueError: for a cell that cannot be made.
    """
    check_known("trainer", spec.trainer, TRAINERS)
    if spec.episodes > STARTS_APART:
        raise SpecError(f"`episodes` must be at most {STARTS_APART}, got {spec.episodes}")
    learner = spec.training.get(ALGORITHM, DEFAULT_ALGORITHM)
    check_known(f"`{ALGORITHM}` in `training`", learner, ALGORITHMS)
    if spec.trainer == "fleet" and learner != DEFAULT_ALGORITHM:
        raise SpecError(
            f"the fleet does not train by {spec.algorithm.config.algorithm}; take "
            '`trainer = "sb3"`, or --trainer sb3'
        )
    if list(spec.looks) != sorted({n for n in spec.looks if n >= MIN_SEEDS}):
        raise SpecError(
            f"`looks` must hold numbers of seeds from {MIN_SEEDS} on, each above the one before, "
            f"got {list(spec.looks)}; `looks = [{len(spec.seeds)}]` spends the whole level at once"
        )
    columns = [cell.name for cell in spec.columns()]
    homes = {spec.name_of(home): home for home in spec.train}
    mixtures = [home.name for home in spec.train if isinstance(home, DiscretizationMixture)]
    for label in ("seeds", "baselines", "family", "compare"):
        check_unique(label, getattr(spec, label))
    check_unique("variations", [one.name for one in spec.variations])
    files = list(map(file_name, (*columns, *mixtures, *spec.baselines)))
    check_unique("names of rows, cells and baselines, as files have them", files)
    check_cells(spec, (*spec.train, None))
    for place in spec.trained_on():
        if place not in spec.grid and place != spec.reference:
            raise SpecError(
                "every training discretization must also be evaluated, "
                f"{spec.name_of(place)!r} is not; add it to `evaluate`"
            )
    for row, cell_name in spec.family:
        check_known("training discretization in `family`", row, homes)
        check_known("cell in `family`", cell_name, columns)
        if cell_name in spec.shares_of(homes[row]):
            raise SpecError(
                f"`family` compares {row!r} with its own home {cell_name!r}; name a cell that it "
                "was not trained in"
            )
    for pair in spec.compare:
        for row in pair:
            check_known("training discretization in `compare`", row, homes)
        check_unique("compare", pair)
        _check_comparison(spec, [homes[row] for row in pair])


def check_cells(spec: PanelSpec, homes: Sequence[Home | None]) -> None:
    """Refuse cells that cannot be made, and those whose records would have other columns.

    Args:
        spec: the panel.
        homes: of its policies; None: unknown.

    Raises:
        SpecError: for a variation that is possible in no cell, with what is wrong, and for cells of
            one name, or with other columns.
        TypeError, ValueError: for another cell that cannot be made.
    """
    own = tuple(dict.fromkeys(place for home in homes if home for place in home.shares))
    for one in spec.variations:
        faults = {fault for _, fault in replace(spec, variations=(one,)).varied(own)}
        if faults and None not in faults:
            raise SpecError(f"{one.name!r} is possible in no cell: {min(map(str, faults))}")
    cells = [spec.cells_of(home) for home in homes]
    for several in cells:
        check_unique("cells", [cell.name for cell in several])
    columns, testbed = attrgetter("plant.coordinates", "plant.controls"), spec.testbed
    same = columns(spec.nominal)
    for cell in {cell.name: cell for several in cells for cell in several}.values():
        if columns(setup_of(testbed, cell)) != same:
            raise SpecError(
                f"{cell.name!r} has another state or other controls, so its records fit in no file "
                "with the rest; give the argument to all cells, in `environment`"
            )


def _check_comparison(spec: PanelSpec, homes: Sequence[Home]) -> None:
    """A comparison is decided at a quarter of each home's step and on the reference.

    Of the steps that a mixture has of one integrator, the coarsest counts.
    """
    if spec.reference is None:
        raise SpecError(
            f"`compare` is decided on the truth, and {spec.env_id} has none; leave it out"
        )
    places = {place for home in homes for place in home.shares} - {spec.reference}
    by_step = sorted(places, key=lambda place: (place.dt, place.name))
    for scheme, place in {place.scheme: place for place in by_step}.items():
        finest = min(d.dt for d in spec.grid if d.scheme == scheme)
        if finest * 4.0 > place.dt * (1.0 + 1e-9):
            raise SpecError(
                f"`compare` needs {place.integrator} evaluated at dt={place.dt / 4.0:g} or finer, "
                f"a quarter of {spec.name_of(place)}'s; add it to `evaluate`"
            )


BUILT_IN = ("quick", "engines")
"""Panels that come with the package."""

LARGEST_FILE = 1 << 20
"""Bytes of a specification, at most."""


class PerturbationTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of `perturbations`: arguments that differ at home and on the truth.

    Attributes:
        name: unique.
        environment: constructor arguments.
    """

    name: Name
    environment: Annotated[dict[str, Any], msgspec.Meta(min_length=1)]


class SweepTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of `sweep`: an argument that takes several values at home and on the truth.

    Attributes:
        argument: constructor argument of the environment.
        values: what it takes, two numbers or more.
    """

    argument: Name
    values: Annotated[list[float], msgspec.Meta(min_length=2)]


@dataclass(frozen=True, kw_only=True)
class Specification(Stated):
    """A panel's file, before its tables are expanded."""

    seeds: Annotated[tuple[Count, ...], msgspec.Meta(min_length=1)]
    train: Annotated[list[dict[str, Any]], msgspec.Meta(min_length=1)]
    evaluate: list[dict[str, Any]]
    perturbations: list[PerturbationTable] | None = None
    sweep: list[SweepTable] = field(default_factory=list)
    baselines: tuple[Name, ...] | None = None
    episodes: Several | Annotated[list[Several], msgspec.Meta(min_length=1)] = PanelSpec.episodes
    limit: bool | None = None


SCHEMA_PATH = Path(__file__).with_name("specification.schema.json")


def schema_text() -> str:
    """JSON Schema (2020-12) of a specification, for editors of TOML: the published file."""
    (whole,), parts = msgspec.json.schema_components([Specification])
    parts[Specification.__name__]["additionalProperties"] = False
    head = schema_head("integ-gym panel specification")
    return published_text({**head, **whole, "$defs": parts})


def read_spec(path: Path | str) -> PanelSpec:
    """Read a specification from a TOML file, or by the name of a built-in one.

    Raises:
        SpecError: if the file cannot be read, or is no valid specification.
    """
    others = f", or a built-in panel: {', '.join(BUILT_IN)}"
    own = Path(__file__).with_name("built_in") / f"{path}.toml" if path in BUILT_IN else Path(path)
    return parse_spec(read_toml(own, others), source=str(own))


def read_toml(path: Path, others: str = "") -> dict[str, Any]:
    """The plain data of a specification.

    Args:
        path: of the file.
        others: what may be given in place of a file, for its error.

    Raises:
        SpecError: if the file cannot be read, or is no TOML.
    """
    try:
        return tomllib.loads(read_bounded(path, LARGEST_FILE).decode())
    except OSError as error:
        fault = f"cannot be read: {error.strerror}; give the path of a TOML file{others}"
    except (RecursionError, ValueError) as error:
        fault = f"is no TOML: {error}; docs/reference/panel.md has the format"
    raise SpecError(f"the specification {path} {fault}")


def parse_spec(data: Mapping[str, Any], source: str) -> PanelSpec:
    """Check plain data and expand it.

    Raises:
        SpecError: for an unknown key or an impossible value, naming ``source``.
    """
    try:
        return _parse(data)
    except (TypeError, ValueError) as error:
        raise SpecError(f"{source}: {error}") from error


def _parse(data: Mapping[str, Any]) -> PanelSpec:
    for key in data:
        check_known("key", key, get_type_hints(Specification))
    stated = convert("", dict(data), Specification)
    for name in sorted({*stated.environment} & {*DISCRETIZATION, "mixture"}):
        raise SpecError(
            f"`environment` gives `{name}`, which is what cells vary; use `control_period`, "
            "`train` and `evaluate` for it"
        )
    testbed = find_testbed(stated.env_id, stated.environment)
    home = replace(testbed.home, control_period=stated.control_period)
    nominal = nominal_setup(testbed, home.control_period)
    both = {"at": ["home", "truth"]}
    tables = [{**both, "name": x.name, **x.environment} for x in stated.perturbations or ()]
    tables += [{**both, x.argument: sorted(x.values)} for x in stated.sweep]
    grid, variations, unmade = evaluation_cells([*stated.evaluate, *tables], home)
    train, parts = training_homes(stated.train, home), tuple(many(stated.episodes))
    standard = standard_variations(nominal) if stated.perturbations is None else ()
    possible = possible_baselines(nominal, testbed.controller)
    limit, no_limit = choose_steps(testbed, train, home, stated.limit)
    spec = PanelSpec(
        **{one.name: getattr(stated, one.name) for one in fields(Stated)},
        train=train,
        grid=grid,
        baselines=possible if stated.baselines is None else stated.baselines,
        variations=(*standard, *variations),
        limit=limit,
        episodes=sum(parts),
        episode_parts=parts if len(parts) > 1 else (),
        unmade=(*unmade, *no_limit),
    )
    check_parts(spec)
    return spec
