"""A specification read from TOML."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.support.files import read_bounded
from integ_gym.train.baselines import possible_baselines

from .cells.cell import nominal_setup
from .cells.discretizations import asks_for_installed, evaluated, trained
from .cells.engines import absent_engines
from .cells.perturbations import perturbations_of
from .cells.sweeps import sweeps_of
from .checks import check_environment, check_parts
from .panel_spec import PanelSpec
from .values import (
    SpecError,
    check_keys,
    flag,
    integer,
    list_of,
    many,
    pair_of,
    positive,
    table,
    text,
)

BUILT_IN = ("quick", "engines")
"""Panels that come with the package."""

_VALUES: dict[str, Callable[[str, Any], Any]] = {
    "name": text,
    "question": text,
    "env_id": text,
    "control_period": positive,
    "trainer": text,
    "memory_gib": positive,
    "ladder": flag,
    "episode_seed": integer,
    "exploratory_seeds": integer,
    "trace_every": integer,
}
"""Key of a single value to what reads it."""

_LISTS: dict[str, Callable[[str, Any], Any]] = {
    "seeds": integer,
    "looks": integer,
    "baselines": text,
    "family": pair_of,
    "compare": pair_of,
}
"""Key of a list to what reads each of its values."""

LARGEST_FILE = 1 << 20
"""Bytes of a specification, at most."""

_KEYS = (
    *_VALUES, *_LISTS, "episodes", "environment", "training", "train", "evaluate", "perturbations",
    "sweep",
)  # fmt: skip
_REQUIRED = ("name", "env_id", "control_period", "seeds", "train", "evaluate")


def built_in_spec(name: str = "quick") -> PanelSpec:
    """A panel that comes with the package."""
    file = resources.files(__package__) / "built_in" / f"{name}.toml"
    content = file.read_text(encoding="utf-8")
    return parse_spec(tomllib.loads(content), source=f"built-in panel {name!r}")


def read_spec(path: Path) -> PanelSpec:
    """Read a specification from a TOML file.

    Raises:
        SpecError: if the file cannot be read, or is no valid specification.
    """
    return parse_spec(read_toml(path), source=str(path))


def read_toml(path: Path) -> dict[str, Any]:
    """The plain data of a specification.

    Raises:
        SpecError: if the file cannot be read, or is no TOML.
    """
    try:
        return tomllib.loads(read_bounded(path, LARGEST_FILE).decode())
    except UnicodeDecodeError as error:
        raise SpecError(f"{path} is not UTF-8 text; save it as UTF-8") from error
    except OSError as error:
        raise SpecError(
            f"cannot read the specification {path}: {error.strerror}; give the path of a TOML "
            f"file, or a built-in panel: {', '.join(BUILT_IN)}"
        ) from error
    except tomllib.TOMLDecodeError as error:
        raise SpecError(
            f"{path} is not valid TOML: {error}; docs/reference/panel.md has the format"
        ) from error
    except RecursionError:
        raise SpecError(
            f"{path} is nested too deep to be a specification; docs/reference/panel.md has the "
            "format"
        ) from None
    except ValueError as error:
        raise SpecError(
            f"{path} cannot be a specification: {error}; docs/reference/panel.md has the format"
        ) from None


def parse_spec(data: Mapping[str, Any], source: str) -> PanelSpec:
    """Check plain data and expand it.

    Raises:
        SpecError: for an unknown key or an impossible value, naming ``source``.
    """
    try:
        spec = _parse(data)
        check_parts(spec)
    except SpecError as error:
        raise SpecError(f"{source}: {error}") from None
    except (TypeError, ValueError) as error:
        raise SpecError(f"{source}: {error}") from error
    return spec


def _parse(data: Mapping[str, Any]) -> PanelSpec:
    check_keys("key", data, _KEYS)
    missing = [key for key in _REQUIRED if key not in data]
    if missing:
        raise SpecError(f"missing key {missing[0]!r}; see docs/reference/panel.md for the format")
    given = {key: read(key, data[key]) for key, read in _VALUES.items() if key in data}
    for key, read in _LISTS.items():
        if key in data:
            given[key] = tuple(read(key, value) for value in list_of(data, key))
    if "episodes" in data:
        given |= _episodes(data["episodes"])
    given |= {key: dict(table(data, key)) for key in ("environment", "training")}
    check_environment(given["environment"])
    testbed = find_testbed(given["env_id"], given["environment"])
    of = replace(testbed.home, control_period=given["control_period"])
    nominal = nominal_setup(testbed, of.control_period)
    if "baselines" not in data:
        given["baselines"] = possible_baselines(nominal, testbed.controller)
    return PanelSpec(
        **given,
        train=trained(data, of),
        grid=evaluated(data, of),
        perturbations=perturbations_of(data, nominal),
        sweeps=sweeps_of(data, nominal),
        left_out=absent_engines() if any(map(asks_for_installed, data["evaluate"])) else (),
    )


def _episodes(value: Any) -> dict[str, Any]:
    """How many there are, and in which parts, where there are several."""
    parts = tuple(integer("episodes", part) for part in many(value))
    if 0 in parts or not parts:
        raise SpecError(f"`episodes` must be 1 or above, or a list of such parts, got {value!r}")
    return {"episodes": sum(parts), "episode_parts": parts if len(parts) > 1 else ()}
