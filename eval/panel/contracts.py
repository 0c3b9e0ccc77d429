"""Whether cells on another engine than a policy's home keep its contract, before any verdict.

Each home and each discretization on another engine are compared once, as a unit of work, at the
panel's own arguments: what a variation changes on purpose is no fault.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, TypeAlias

import msgspec

from integ_gym.envs.engines.stepping import engine_versions
from integ_gym.envs.settings import Discretization
from integ_gym.support.errors import InputError

from ..contract import Contract, boundaries_of, compare_boundaries, without_delays
from .cells import Cell, Home, environments_of, file_name, place_name
from .run_directory import RunDirectory, key_of
from .spec import PanelSpec
from .units import Work

PREFIX = "contract-"


class Pair(NamedTuple):
    """A home, and where else its policies are judged, on another engine."""

    home: Discretization
    place: Discretization


Contracts: TypeAlias = Mapping[Pair, Contract]


def pairs_of(spec: PanelSpec, homes: Iterable[Home | None]) -> dict[str, Pair]:
    """What is to be compared, by name of the unit.

    Args:
        spec: the panel.
        homes: of its policies; None: unknown, or none.
    """
    found = (
        Pair(member, cell.discretization)
        for home in dict.fromkeys(homes)
        if home is not None
        for cell in spec.cells_of(home)
        for member in home.shares
        if cell.engine != member.engine and not cell.packages
    )
    return {unit_of_pair(spec, pair): pair for pair in dict.fromkeys(found)}


def compare_engines(
    spec: PanelSpec, directory: RunDirectory, homes: Iterable[Home | None], work: Work
) -> None:
    """Compare every pair that has not been, each a unit.

    Raises:
        RunDirectoryError: if one was compared under another specification or version.
    """
    pairs = not_compared(spec, directory, homes)
    waiting = {unit: (spec, pair) for unit, pair in pairs.items()}
    work.commit("comparing engines", compare_and_note, waiting)


def not_compared(
    spec: PanelSpec, directory: RunDirectory, homes: Iterable[Home | None]
) -> dict[str, Pair]:
    """Pairs that have not been compared, by name of the unit; see :func:`compare_engines`."""
    return {
        unit: pair
        for unit, pair in pairs_of(spec, homes).items()
        if directory.finished(unit, key_of_pair(spec, pair)) is None
    }


def compare_and_note(spec: PanelSpec, directory: RunDirectory, pair: Pair) -> None:
    """Compare a pair, and mark that as finished."""
    start, unit = time.time(), unit_of_pair(spec, pair)
    facts = describe_comparison(pair, contract_of(spec, pair))
    directory.finish(unit, key_of_pair(spec, pair), start, **facts)


def contract_of(spec: PanelSpec, pair: Pair) -> Contract | None:
    """A pair compared; None where states of the two do not correspond."""
    testbed, prompt = spec.testbed, without_delays(spec.testbed)
    places = [environments_of(testbed, Cell.of(one, "grid"), 1, **prompt) for one in pair]
    try:
        both = [boundaries_of(testbed, environments) for environments in places]
        return compare_boundaries([place_name(one, spec.control_period) for one in pair], both)
    except InputError:
        return None
    finally:
        for environments in places:
            environments.close()


def describe_comparison(pair: Pair, contract: Contract | None) -> dict[str, Any]:
    """What a unit's marker says of a pair, as plain data."""
    description = msgspec.to_builtins(contract)
    return {"home": pair.home.arguments(), "place": pair.place.arguments(), "contract": description}


def contracts_in(directory: RunDirectory) -> dict[Pair, Contract]:
    """What was compared, by pair."""
    found = {}
    for marker in directory.markers(PREFIX).values():
        contract = msgspec.convert(marker["contract"], Contract | None)
        if contract is not None:
            pair = Pair(Discretization(**marker["home"]), Discretization(**marker["place"]))
            found[pair] = contract
    return found


def is_kept(contracts: Contracts, homes: Iterable[Discretization], cell: Cell) -> bool | None:
    """Whether a cell keeps the contract of a home, of a mixture that of any of its members.

    None where that was not compared, as on a home's own engine.
    """
    if cell.packages:
        return None
    own = [contracts.get(Pair(home, cell.discretization)) for home in homes]
    known = [not contract.broken for contract in own if contract is not None]
    if any(known):
        return True
    return False if known and len(known) == len(own) else None


def unit_of_pair(spec: PanelSpec, pair: Pair) -> str:
    """Name of the unit that compares a pair."""
    names = (file_name(place_name(one, spec.control_period)) for one in pair)
    return f"{PREFIX}{'-and-'.join(names)}"


def key_of_pair(spec: PanelSpec, pair: Pair) -> str:
    """Hash of all that the comparison depends on: nothing that may be added to a panel."""
    return key_of(engines_of(pair), **key_parts(spec, pair))


def engines_of(pair: Pair) -> dict[str, str]:
    """Distribution and version of its foreign engines."""
    return engine_versions({one.engine for one in pair})


def key_parts(spec: PanelSpec, pair: Pair) -> dict[str, Any]:
    """What its key is made of, beside versions."""
    environment = dict(sorted(spec.environment.items()))
    return {
        "env_id": spec.env_id, "environment": environment,
        "pair": [one.arguments() for one in pair],
    }  # fmt: skip
