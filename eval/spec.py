"""The panel's specification: read from TOML, checked, expanded into rows and cells."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from integ_gym.envs.integrators import INTEGRATORS
from integ_gym.envs.mixture import WEIGHT
from integ_gym.envs.parameters import unknown_name
from integ_gym.envs.registration import environment_setup
from integ_gym.envs.versions import package_version
from integ_gym.eval.cells import (
    Cell,
    Discretization,
    DiscretizationMixture,
    Home,
    Perturbation,
    dividing_step,
    file_name,
)
from integ_gym.eval.engine_cells import (
    INSTALLED,
    absent_engines,
    engine_versions,
    on_installed,
)

BUILT_IN = ("quick", "engines")
"""Panels that come with the package."""

BASELINES = ("random", "zero", "handmade")
"""Policies without training that every panel holds its rows against."""

TRAINERS = ("sb3", "fleet")

LARGEST_SEED = 2**32 - 1

_DELAYS = {"action_latency", "sensor_period", "observation_noise", "fallback"}
"""Arguments that disturb what the policy is told and does, not the plant."""


class SpecError(ValueError):
    """A specification that cannot be run, in one sentence with the remedy."""


@dataclass(frozen=True)
class PanelSpec:
    """One panel; see docs/panel.md for the TOML form."""

    name: str
    env_id: str
    control_period: float
    train: tuple[Home, ...]
    grid: tuple[Discretization, ...]
    seeds: tuple[int, ...]
    environment: Mapping[str, Any] = field(default_factory=dict)
    training: Mapping[str, Any] = field(default_factory=dict)
    baselines: tuple[str, ...] = ()
    perturbations: tuple[Perturbation, ...] = ()
    family: tuple[tuple[str, str], ...] = ()
    """Declared comparisons: (training discretization or mixture, cell)."""
    compare: tuple[tuple[str, str], ...] = ()
    """Pairs of the same whose policies are compared under refinement."""
    trainer: str = "sb3"
    """`sb3` (stable-baselines3) or `fleet` (compiled; all policies at once)."""
    ladder: bool = True
    """Also refine each policy's own discretization with the control period following dt."""
    episodes: int = 20
    episode_seed: int = 1000
    question: str = "Does a policy trained on one integrator and timestep survive another?"
    left_out: tuple[str, ...] = ()
    """Engines that are not installed, where the grid asks for all that are."""

    @property
    def reference(self) -> Discretization:
        """The truth column: the plant solved to rounding under the same zero-order hold."""
        return Discretization("reference", self.control_period, self.control_period)

    def columns(self) -> tuple[Cell, ...]:
        """Cells that every row is evaluated in: the grid, then the reference."""
        grid = tuple(
            Cell(d, "grid", role="quarter_step" if self._decides(d) else None)
            for d in self.grid
            if d != self.reference
        )
        return (*grid, Cell(self.reference, "reference", role="reference"))

    def trained_on(self) -> tuple[Discretization, ...]:
        """All discretizations that something is trained on."""
        return tuple(dict.fromkeys(d for home in self.train for d in home.shares))

    def _decides(self, discretization: Discretization) -> bool:
        """Whether it is its integrator's finest step, a quarter of what it was trained at."""
        own = (discretization.engine, discretization.integrator)
        dts = [d.dt for d in self.grid if (d.engine, d.integrator) == own]
        homes = [d.dt for d in self.trained_on() if (d.engine, d.integrator) == own]
        coarsest = max(homes, default=self.control_period)
        finest = discretization.dt <= min(dts)
        return finest and discretization.dt * 4.0 <= coarsest * (1.0 + 1e-9)

    def gaps(self) -> list[str]:
        """What every panel has and this one lacks, in sentences."""
        found = [f"There is no baseline {b!r}." for b in BASELINES if b not in self.baselines]
        changed = {name for p in self.perturbations for name in p.environment}
        if not changed - _DELAYS:
            found.append("No perturbation of the plant is evaluated.")
        if "action_latency" not in changed:
            found.append("No action latency is evaluated.")
        found += [
            f'Engine {name} is not installed, so it is left out: pip install "integ-gym[{name}]".'
            for name in self.left_out
        ]
        setup = environment_setup(self.env_id, self.columns()[-1].arguments(self.environment))
        if setup.settings.duration < setup.task.goal_stay:
            found.append(
                f"Episodes last {setup.settings.duration:g} s, but success takes "
                f"{setup.task.goal_stay:g} s at the goal: nobody can succeed."
            )
        return found

    def cells_of(self, home: Home | None) -> tuple[Cell, ...]:
        """Cells of one row, those it was trained in first: columns, perturbations, its ladder."""
        own = () if home is None else tuple(home.shares)
        columns = sorted(self.columns(), key=lambda cell: cell.discretization not in own)
        perturbed = [
            Cell(d, "perturbation", perturbation=p)
            for p in self.perturbations
            for d in dict.fromkeys((*own, self.reference))
        ]
        return (*columns, *perturbed, *self._ladder(home))

    def _ladder(self, home: Home | None) -> tuple[Cell, ...]:
        """Of a single discretization: a mixture has no step of its own to refine."""
        if not self.ladder or not isinstance(home, Discretization):
            return ()
        steps = [home.dt / 2.0, home.dt / 4.0]
        return tuple(
            Cell(Discretization(home.integrator, dt, dt, home.engine), "ladder") for dt in steps
        )

    def engine_versions(self) -> dict[str, str]:
        """Version of the distribution behind each foreign engine that is used."""
        return engine_versions({d.engine for d in (*self.trained_on(), *self.grid)})

    def to_json(self) -> dict[str, Any]:
        """The specification as plain data, everything resolved."""
        return {
            "name": self.name,
            "question": self.question,
            "env_id": self.env_id,
            "control_period": self.control_period,
            "environment": dict(self.environment),
            "training": dict(self.training),
            "trainer": self._trainer(),
            "train": [_plain(home) for home in self.train],
            "grid": [d.arguments() for d in self.grid],
            "seeds": list(self.seeds),
            "baselines": list(self.baselines),
            "perturbations": [
                {"name": p.name, "environment": dict(p.environment)} for p in self.perturbations
            ],
            "family": [list(pair) for pair in self.family],
            "compare": [list(pair) for pair in self.compare],
            "ladder": self.ladder,
            "episodes": self.episodes,
            "episode_seed": self.episode_seed,
            "sources": self._sources(),
        }

    def _trainer(self) -> dict[str, str | None]:
        """The trainer, with what its results depend on beside the packages of every panel."""
        return {"name": self.trainer, **({"jax": package_version("jax")} if self.fleet else {})}

    @property
    def fleet(self) -> bool:
        """Whether the policies are trained by the fleet trainer."""
        return self.trainer == "fleet"

    def _sources(self) -> dict[str, str]:
        """SHA-256 of the source of every integrator of the user's own."""
        used = (*self.trained_on(), *self.grid)
        names = {d.integrator for d in used if d.engine == "native" or ":" in d.integrator}
        hashes = {name: INTEGRATORS.source_hash(name) for name in sorted(names)}
        return {name: value for name, value in hashes.items() if value is not None}


def _plain(home: Home) -> dict[str, Any]:
    """A training discretization or mixture as plain data."""
    if isinstance(home, Discretization):
        return home.arguments()
    members = [{**member.arguments(), WEIGHT: weight} for member, weight in home.weights]
    return {"mixture": home.name, "members": members}


def built_in_spec(name: str = "quick") -> PanelSpec:
    """A panel that comes with the package."""
    text = (resources.files("integ_gym.eval") / f"{name}.toml").read_text(encoding="utf-8")
    return parse_spec(tomllib.loads(text), source=f"built-in panel {name!r}")


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
            "file, or none for the built-in panel"
        ) from error
    except tomllib.TOMLDecodeError as error:
        raise SpecError(f"{path} is not valid TOML: {error}") from error
    return parse_spec(data, source=str(path))


def parse_spec(data: Mapping[str, Any], source: str) -> PanelSpec:
    """Check plain data and expand it.

    Raises:
        SpecError: for an unknown key or an impossible value, naming ``source``.
    """
    try:
        spec = _parse(data)
        _check(spec)
    except SpecError as error:
        raise SpecError(f"{source}: {error}") from None
    except (TypeError, ValueError) as error:
        raise SpecError(f"{source}: {error}") from error
    return spec


_KEYS = (
    "name", "question", "env_id", "control_period", "seeds", "episodes", "episode_seed",
    "baselines", "family", "compare", "ladder", "environment", "training", "trainer", "train",
    "evaluate",
    "perturbations",
)  # fmt: skip
_REQUIRED = ("name", "env_id", "control_period", "seeds", "train", "evaluate")


def _parse(data: Mapping[str, Any]) -> PanelSpec:
    _check_keys("key", data, _KEYS)
    missing = [key for key in _REQUIRED if key not in data]
    if missing:
        raise SpecError(f"missing key {missing[0]!r}; see docs/panel.md for the format")
    period = _positive("control_period", data["control_period"])
    return PanelSpec(
        name=_text("name", data["name"]),
        env_id=_text("env_id", data["env_id"]),
        control_period=period,
        train=_train(data, period),
        grid=_evaluate(data, period),
        seeds=tuple(_integer("seeds", seed) for seed in _list(data, "seeds")),
        environment=dict(_table(data, "environment")),
        training=dict(_table(data, "training")),
        baselines=tuple(_text("baselines", name) for name in _list(data, "baselines", BASELINES)),
        perturbations=_perturbations(data, period),
        family=tuple(_pair("family", pair) for pair in _list(data, "family")),
        compare=tuple(_pair("compare", pair) for pair in _list(data, "compare")),
        trainer=_text("trainer", data.get("trainer", PanelSpec.trainer)),
        ladder=_flag(data, "ladder", True),
        episodes=_integer("episodes", data.get("episodes", 20)),
        episode_seed=_integer("episode_seed", data.get("episode_seed", 1000)),
        question=_text("question", data.get("question", PanelSpec.question)),
        left_out=absent_engines() if any(map(_asks_for_installed, data["evaluate"])) else (),
    )


def _check(spec: PanelSpec) -> None:
    _known("trainer", spec.trainer, TRAINERS)
    if spec.episodes < 1 or not spec.seeds or not spec.train:
        raise SpecError("`episodes`, `seeds` and `train` must each hold at least one")
    named: dict[str, Sequence[Any]] = {
        "seeds": spec.seeds,
        "train": [home.name for home in spec.train],
        "baselines": spec.baselines,
        "perturbations": [p.name for p in spec.perturbations],
        "family": spec.family,
        "compare": spec.compare,
    }
    for label, values in named.items():
        _check_unique(label, values)
    for perturbation in spec.perturbations:
        varied = set(perturbation.environment) & set(spec.reference.arguments())
        if varied:
            raise SpecError(
                f"perturbation {perturbation.name!r} changes `{sorted(varied)[0]}`, which is what "
                "cells vary; use `evaluate` for it"
            )
    _check_environment(spec)
    every = [spec.cells_of(home) for home in (*spec.train, None)]
    for cells in every:
        _check_unique("cells", [cell.name for cell in cells])
    for cell in {cell.name: cell for cells in every for cell in cells}.values():
        environment_setup(spec.env_id, cell.arguments(spec.environment))
    for trained in spec.trained_on():
        if trained not in spec.grid and trained != spec.reference:
            raise SpecError(
                f"every training discretization must also be evaluated, {trained.name!r} is not; "
                "add it to `evaluate`"
            )
    columns = {cell.name for cell in spec.columns()}
    _check_mixture_names(spec, columns)
    homes = {home.name: home for home in spec.train}
    for home_name, cell_name in spec.family:
        _known("training discretization in `family`", home_name, homes)
        _known("cell in `family`", cell_name, columns)
        if cell_name in {member.name for member in homes[home_name].shares}:
            raise SpecError(
                f"`family` compares {home_name!r} with its own home {cell_name!r}; name a cell "
                "that it was not trained in"
            )
    for pair in spec.compare:
        for name in pair:
            _known("training discretization in `compare`", name, homes)
        _check_comparison(spec, pair)


def _check_mixture_names(spec: PanelSpec, columns: set[str]) -> None:
    """A mixture's name must be no other row's, no cell's, and one of its own as a file's."""
    files = [file_name(name) for name in (*(home.name for home in spec.train), *spec.baselines)]
    for home in spec.train:
        if isinstance(home, Discretization):
            continue
        if home.name in columns or files.count(file_name(home.name)) > 1:
            raise SpecError(
                f"mixture {home.name!r} is named like another row or cell; give it another name"
            )


def _check_environment(spec: PanelSpec) -> None:
    varied = set(spec.environment) & {*spec.reference.arguments(), "mixture"}
    if varied:
        raise SpecError(
            f"`environment` gives `{sorted(varied)[0]}`, which is what cells vary; use "
            "`control_period`, `train` and `evaluate` for it"
        )


def _check_unique(label: str, values: Sequence[Any]) -> None:
    if len(set(values)) != len(values):
        raise SpecError(f"`{label}` lists something twice: {list(values)}")


def _check_comparison(spec: PanelSpec, pair: tuple[str, str]) -> None:
    """A comparison is decided at a quarter of each home's step and on the reference.

    Of the steps that a mixture has of one integrator, the coarsest counts.
    """
    if pair[0] == pair[1]:
        raise SpecError(f"`compare` names {pair[0]!r} twice; name two training discretizations")
    homes = {d for home in spec.train if home.name in pair for d in home.shares}
    by_step = sorted(homes - {spec.reference}, key=lambda d: (d.dt, d.name))
    for own, home in {(d.engine, d.integrator): d for d in by_step}.items():
        finest = min(d.dt for d in spec.grid if (d.engine, d.integrator) == own)
        if finest * 4.0 > home.dt * (1.0 + 1e-9):
            raise SpecError(
                f"`compare` needs {home.integrator} evaluated at dt={home.dt / 4.0:g} or finer, a "
                f"quarter of {home.name}'s; add it to `evaluate`"
            )


def _train(data: Mapping[str, Any], period: float) -> tuple[Home, ...]:
    """Training discretizations and mixtures, in order."""
    found: list[Home] = []
    for entry in _list(data, "train"):
        if isinstance(entry, Mapping) and "mixture" in entry:
            found.append(_mixture(entry, period))
        else:
            found += [member for member, _ in _expand("train", entry, period)]
    return tuple(dict.fromkeys(found))


def _evaluate(data: Mapping[str, Any], period: float) -> tuple[Discretization, ...]:
    entries: list[Any] = []
    for entry in _list(data, "evaluate"):
        entries += on_installed(entry) if _asks_for_installed(entry) else [entry]
    found = [member for entry in entries for member, _ in _expand("evaluate", entry, period)]
    return tuple(dict.fromkeys(found))


def _asks_for_installed(entry: Any) -> bool:
    return isinstance(entry, Mapping) and entry.get("engine") == INSTALLED


def _mixture(entry: Mapping[str, Any], period: float) -> DiscretizationMixture:
    """A table with a name and ``members``, whose weights hold for each that they expand to."""
    _check_keys("key of a mixture in `train`", entry, ("mixture", "members"))
    name = _text("mixture", entry["mixture"])
    members = [
        expanded
        for member in _list(entry, "members")
        for expanded in _expand(f"members of {name}", member, period, (WEIGHT,))
    ]
    if len(members) < 2:
        raise SpecError(
            f"mixture {name!r} needs at least two `members`, got {len(members)}; a single "
            "discretization is trained on without a mixture"
        )
    _check_unique(f"members of {name}", [member.name for member, _ in members])
    return DiscretizationMixture(name, tuple(members))


def _expand(
    key: str, entry: Any, period: float, more: tuple[str, ...] = ()
) -> list[tuple[Discretization, float]]:
    """Discretizations of a table in which integrator and dt may be lists, with their weight."""
    if not isinstance(entry, Mapping):
        raise SpecError(
            f"every entry of `{key}` must be a table with `integrator` and `dt`, got {entry!r}"
        )
    _check_keys(f"key in `{key}`", entry, ("integrator", "dt", "engine", *more))
    if "integrator" not in entry or "dt" not in entry:
        raise SpecError(f"every entry of `{key}` needs `integrator` and `dt`")
    engine = _text("engine", entry.get("engine", "native"))
    weight = _positive(WEIGHT, entry.get(WEIGHT, 1.0))
    return [
        (
            Discretization(_text("integrator", integrator), _positive("dt", dt), period, engine),
            weight,
        )
        for integrator in _many(entry["integrator"])
        for dt in _many(entry["dt"])
    ]


def _perturbations(data: Mapping[str, Any], period: float) -> tuple[Perturbation, ...]:
    """Those given; where the key is left out, those of every panel."""
    if "perturbations" in data:
        return tuple(_perturbation(entry) for entry in _list(data, "perturbations"))
    given = {"control_period": period, "dt": period, **_table(data, "environment")}
    return standard_perturbations(str(data["env_id"]), {**given, "integrator": "reference"})


def standard_perturbations(
    env_id: str, arguments: Mapping[str, Any]
) -> tuple[Perturbation, Perturbation]:
    """A heavier plant and a later command: what every panel checks.

    Args:
        env_id: environment.
        arguments: constructor arguments of an undisturbed cell.
    """
    setup = environment_setup(env_id, {**arguments, "dt": dividing_step(arguments)})
    period = setup.timing.control_period
    later = setup.settings.action_latency + period
    return (
        Perturbation("mass +20 %", {"mass": 1.2 * setup.arguments()["mass"]}),
        Perturbation(f"latency +{1000.0 * period:g} ms", {"action_latency": later}),
    )


def _perturbation(entry: Any) -> Perturbation:
    if not isinstance(entry, Mapping) or not isinstance(entry.get("environment", {}), Mapping):
        raise SpecError(
            f"every perturbation must be a table with a `name` and a table `environment`, got "
            f"{entry!r}"
        )
    _check_keys("key in `perturbations`", entry, ("name", "environment"))
    if not entry.get("name") or not entry.get("environment"):
        raise SpecError("every perturbation needs a `name` and an `environment` table")
    return Perturbation(str(entry["name"]), dict(entry["environment"]))


def _check_keys(kind: str, data: Mapping[str, Any], valid: Sequence[str]) -> None:
    for key in data:
        _known(kind, key, valid)


def _known(kind: str, name: str, valid: Iterable[str]) -> None:
    if name not in valid:
        raise SpecError(unknown_name(kind, name, valid))


def _many(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _list(data: Mapping[str, Any], key: str, default: Sequence[Any] = ()) -> list[Any]:
    value = data.get(key, list(default))
    if not isinstance(value, list):
        raise SpecError(f"`{key}` must be a list, got {value!r}")
    return value


def _table(data: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = data.get(key, {})
    if not isinstance(value, Mapping):
        raise SpecError(f"`{key}` must be a table, got {value!r}")
    return value


def _text(key: str, value: Any) -> str:
    if not isinstance(value, str) or not value:
        raise SpecError(f"`{key}` must be made of names in quotes, got {value!r}")
    return value


def _flag(data: Mapping[str, Any], key: str, default: bool) -> bool:
    value = data.get(key, default)
    if not isinstance(value, bool):
        raise SpecError(f"`{key}` must be true or false, got {value!r}")
    return value


def _positive(key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < math.inf:
        raise SpecError(f"`{key}` must be a finite number above 0, got {value!r}")
    return float(value)


def _integer(key: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= LARGEST_SEED:
        raise SpecError(
            f"`{key}` must be made of whole numbers from 0 to {LARGEST_SEED}, got {value!r}"
        )
    return value


def _pair(key: str, value: Any) -> tuple[str, str]:
    if not isinstance(value, list) or len(value) != 2:
        raise SpecError(f"every entry of `{key}` must be a pair of names, got {value!r}")
    return str(value[0]), str(value[1])
