"""A specification read from TOML."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

from integ_gym.envs import testbed_of
from integ_gym.train import possible_baselines

from .cells import nominal_setup
from .checks import check_environment, check_parts
from .discretizations import asks_for_installed, evaluated, trained
from .engine_cells import absent_engines
from .panel_spec import PanelSpec
from .perturbations import perturbations_of
from .values import SpecError, check_keys, flag, integer, list_of, pair_of, positive, table, text

BUILT_IN = ("quick", "engines")
"""Panels that come with the package."""

_KEYS = (
    "name", "question", "env_id", "control_period", "seeds", "episodes", "episode_seed",
    "baselines", "family", "compare", "ladder", "environment", "training", "trainer", "train",
    "evaluate",
    "memory_gib", "perturbations",
)  # fmt: skip
_REQUIRED = ("name", "env_id", "control_period", "seeds", "train", "evaluate")


def built_in_spec(name: str = "quick") -> PanelSpec:
    """A panel that comes with the package."""
    content = (resources.files(__package__) / f"{name}.toml").read_text(encoding="utf-8")
    return parse_spec(tomllib.loads(content), source=f"built-in panel {name!r}")


def read_spec(path: Path) -> PanelSpec:
    """Read a specification from a TOML file.

    Raises:
        SpecError: if the file cannot be read, or is no valid specification.
    """
    try:
        with path.open("rb") as file:
            data = tomllib.load(file)
    except UnicodeDecodeError as error:
        raise SpecError(f"{path} is not UTF-8 text; save it as UTF-8") from error
    except OSError as error:
        raise SpecError(
            f"cannot read the specification {path}: {error.strerror}; give the path of a TOML "
            f"file, or a built-in panel: {', '.join(BUILT_IN)}"
        ) from error
    except tomllib.TOMLDecodeError as error:
        raise SpecError(
            f"{path} is not valid TOML: {error}; docs/panel.md has the format"
        ) from error
    return parse_spec(data, source=str(path))


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
        raise SpecError(f"missing key {missing[0]!r}; see docs/panel.md for the format")
    env_id, environment = text("env_id", data["env_id"]), dict(table(data, "environment"))
    check_environment(environment)
    testbed = testbed_of(env_id, environment)
    period = positive("control_period", data["control_period"])
    of = replace(testbed.home, control_period=period)
    nominal = nominal_setup(testbed, period)
    return PanelSpec(
        name=text("name", data["name"]),
        env_id=env_id,
        control_period=period,
        train=trained(data, of),
        grid=evaluated(data, of),
        seeds=tuple(integer("seeds", seed) for seed in list_of(data, "seeds")),
        environment=environment,
        training=dict(table(data, "training")),
        baselines=_baselines(data, nominal, testbed.controller),
        perturbations=perturbations_of(data, nominal),
        family=tuple(pair_of("family", pair) for pair in list_of(data, "family")),
        compare=tuple(pair_of("compare", pair) for pair in list_of(data, "compare")),
        trainer=text("trainer", data.get("trainer", PanelSpec.trainer)),
        memory_gib=positive("memory_gib", data["memory_gib"]) if "memory_gib" in data else None,
        ladder=flag(data, "ladder", PanelSpec.ladder),
        episodes=integer("episodes", data.get("episodes", PanelSpec.episodes)),
        episode_seed=integer("episode_seed", data.get("episode_seed", PanelSpec.episode_seed)),
        question=text("question", data.get("question", PanelSpec.question)),
        left_out=absent_engines() if any(map(asks_for_installed, data["evaluate"])) else (),
    )


def _baselines(data: Mapping[str, Any], setup: Any, controller: str | None) -> tuple[str, ...]:
    """Those given; where the key is left out, all that can be made for the environment."""
    if "baselines" in data:
        return tuple(text("baselines", name) for name in list_of(data, "baselines"))
    return possible_baselines(setup, controller)
