"""Tables of a specification that say what is trained on and what is evaluated in."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Annotated, Any, TypeAlias

import msgspec

from integ_gym.envs.engines.maps import map_names
from integ_gym.envs.engines.stepping import missing_modules
from integ_gym.envs.registries import ENGINES
from integ_gym.envs.settings import NATIVE, WEIGHT, Discretization
from integ_gym.support.interpreters import PACKAGES, parse_packages
from integ_gym.support.isolated import ISOLATED
from integ_gym.support.optional import install_command

from .cells import (
    DiscretizationMixture,
    Home,
    Name,
    Positive,
    SpecError,
    Variation,
    changes_name,
    check_known,
    check_unique,
    convert,
    many,
    place_name,
    timing_fault,
)

_Finite: TypeAlias = Annotated[float, msgspec.Meta(ge=-sys.float_info.max, le=sys.float_info.max)]


class Places(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of `train` or `evaluate`: every integrator at every step and control period.

    Attributes:
        dt: integration step or steps, s.
        integrator: integrator or integrators, as the engine calls them.
        engine: what advances the plant; None: as at home. `installed`: every installed one.
        control_period: time or times between two decisions, s; None: the panel's.
        map: in place of `integrator` for all installed engines: names of one-step maps, the
            preferred one first.
        weight: of each member of a mixture.
    """

    dt: Positive | list[Positive]
    integrator: Name | list[Name] | None = None
    engine: Name | None = None
    control_period: Positive | list[Positive] | None = None
    map: Name | list[Name] | None = None
    weight: Positive | None = None

    def discretizations(self, home: Discretization) -> list[Discretization]:
        """Every combination, possible or not; on every installed engine where it asks for these."""
        chosen = [(self.engine or home.engine, name) for name in many(self.integrator or [])]
        if self.engine == INSTALLED:
            maps = many(self.map)
            found = ((engine, integrator_applying(engine, maps)) for engine in installed_engines())
            chosen = [(engine, integrator) for engine, integrator in found if integrator]
        return [
            replace(home, engine=engine, integrator=integrator, dt=dt, control_period=period)
            for engine, integrator in chosen
            for period in many(self.control_period or home.control_period)
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


INSTALLED = "installed"
"""In place of an engine's name: every installed one but the native."""

_EASIEST = "mujoco"
"""Of the engines that could be installed, where it serves."""


def absent_engines() -> tuple[str, ...]:
    """Names of the engines whose extra is not installed."""
    return tuple(name for name in ENGINES.names() if name != NATIVE and missing_modules(name))


def installed_engines() -> tuple[str, ...]:
    """Names of the installed engines, without the native one."""
    return tuple(name for name in ENGINES.names() if name not in (NATIVE, *absent_engines()))


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


def evaluation_cells(
    entries: Sequence[Mapping[str, Any]], home: Discretization
) -> tuple[tuple[Discretization, ...], tuple[Variation, ...], tuple[str, ...]]:
    """What the tables of `evaluate` ask for: discretizations of the grid, and variations.

    A table's lists are expanded, and combinations of a step and a control period that is no
    multiple of it are left out, which sentences say. With `integrator` and `dt` alone a table is of
    the grid; with any other argument of the environment it varies these discretizations, and with
    `at` what that names.

    Args:
        entries: the tables of `evaluate`.
        home: see :func:`training_homes`.

    Raises:
        SpecError: for a table of neither form, or if it asks for installed engines, and there is
            none.
    """
    grid: list[Discretization] = []
    variations: list[Variation] = []
    asked: list[Places] = []
    unmade: list[str] = []
    for k, entry in enumerate(entries):
        where, rest = f"evaluate[{k}]", dict(entry)
        name, at = (rest.pop(key, None) for key in ("name", "at"))
        if at is None and not {"integrator", "map", "dt", "engine"} & set(rest):
            at = ["home", "truth"]
        if at is None:
            own = {key: rest.pop(key) for key in Places.__struct_fields__ if key in rest}
            asked.append(convert(where, own, Places))
            places: list[Any] = _expand("evaluate", asked[-1], home)
            if len(many(asked[-1].control_period)) > 1:
                places, faults = fitting(places, [place.dt for place in places])
                unmade += faults
            if not rest:
                grid += places
                continue
        else:
            places = [one for place in many(at) for one in _varied_places(where, place, home)]
        if not rest:
            raise SpecError(f"{where} says `at` and not what is varied; give arguments, or no `at`")
        variations += vary(
            None if name is None else convert(where, name, Name), rest, tuple(places)
        )
    _check_installed(asked, grid)
    return tuple(dict.fromkeys(grid)), tuple(_join(variations)), tuple(unmade)


def _join(variations: Sequence[Variation]) -> Iterator[Variation]:
    """Variations that change the same as one, at the places of all."""
    alike: dict[str, list[Variation]] = {}
    for one in variations:
        alike.setdefault(repr((one.name, one.changes)), []).append(one)
    for first, *others in alike.values():
        at = (*first.at, *(place for other in others for place in other.at))
        yield msgspec.structs.replace(first, at=tuple(dict.fromkeys(at)))


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
    sentences = [
        f"{place.name} is not evaluated at a control period of {place.control_period:g} s: {fault}."
        for place, fault in faults.items()
        if fault
    ]
    fit = [place for place, fault in faults.items() if not fault]
    for place, fault in faults.items():
        lost = place.dt in steps and all(place.dt != one.dt for one in fit)
        if fault and (lost or not fit):
            raise SpecError(fault)
    return fit, sentences


def _varied_places(where: str, place: Any, home: Discretization) -> list[Any]:
    """What an entry of `at` stands for: itself, or the discretizations of its table."""
    if isinstance(place, Mapping):
        return list(_expand("at", convert(f"{where}.at", dict(place), Places), home))
    check_known(f"`at` in {where}", str(place), ("home", "truth"))
    return [place]


def _check_installed(asked: Sequence[Places], grid: Sequence[Discretization]) -> None:
    """Refuse a grid that is about installed engines where none of them is."""
    maps = [name for one in asked if one.engine == INSTALLED for name in many(one.map)]
    if maps and all(one.engine == NATIVE for one in grid):
        absent = absent_engines()
        could = [n for n in absent if n not in ISOLATED and integrator_applying(n, maps)]
        name = min(could or [_EASIEST], key=lambda name: name != _EASIEST)
        raise SpecError(
            "it is about other engines, and none that it could use is installed; run: "
            f"{install_command(name)}, or see `integ-gym engines` for the others"
        )


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
    check_unique(label, [place_name(one, home.control_period) for one, _ in members])
    return DiscretizationMixture(table.mixture, tuple(members))


def vary(name: str | None, table: Mapping[str, Any], at: tuple[Any, ...]) -> Iterator[Variation]:
    """Every combination of a table's lists, named by its values where it has no other name."""
    combinations = expand(table)
    for changes in combinations:
        told = changes_name(changes)
        own = told if name is None else name if len(combinations) == 1 else f"{name}, {told}"
        yield Variation(own, changes, at)


def expand(table: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Every combination of the values in a table's lists, those of tables in it among them.

    The value of `packages` is a list itself, and a list of such lists is expanded.

    Raises:
        ValueError: for `packages` that are no exact versions.
    """
    choices = [
        _package_lists(value)
        if name == PACKAGES
        else expand(value)
        if isinstance(value, Mapping)
        else many(value)
        for name, value in table.items()
    ]
    return [dict(zip(table, chosen, strict=True)) for chosen in product(*choices)]


def _package_lists(value: Any) -> list[list[str]]:
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
    values: Annotated[list[_Finite], msgspec.Meta(min_length=2)]


def shorthand_variations(
    perturbations: Sequence[PerturbationTable], sweeps: Sequence[SweepTable]
) -> Iterator[Variation]:
    """What tables of `perturbations` and of `sweep` stand for."""
    yield from (Variation(one.name, one.environment) for one in perturbations)
    check_unique("sweep", [one.argument for one in sweeps])
    for one in sweeps:
        check_unique(f"values of the sweep of {one.argument}", one.values)
        yield from vary(None, {one.argument: sorted(one.values)}, ("home", "truth"))
