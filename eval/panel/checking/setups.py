"""Where policies were trained and evaluated and from which starts, held against the plan."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import gymnasium as gym
from gymnasium import spaces

from integ_gym.envs.engines.stepping import engine_versions
from integ_gym.envs.environment import is_integ_environment
from integ_gym.envs.settings import DISCRETIZATION, NATIVE, Mixture
from integ_gym.evidence.fields import recorded_arguments
from integ_gym.evidence.schema import EvidenceError, Finding, argument_values, parse_field
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.interpreters import PACKAGES, parse_packages, versions_of
from integ_gym.train.policy_files.card import LAST_EPISODES, episode_summary, make_card, mixture_of
from integ_gym.train.policy_files.sb3_published import zip_faults
from integ_gym.train.policy_files.sidecar import POLICY_FILE, WEIGHTS_FILE

from ..cells import Cell, setup_of
from ..evaluate import Evaluated
from ..plan import read_planned_home
from ..run_directory import PACKAGES as OF_EVERY_RUN
from ..run_directory import RunDirectory, key_of
from ..spec import TRAINERS, PanelSpec
from ..units import Unit, training_config, units_of
from .comparing import Tolerance, deny, find_differences

_SETUPS = """
SELECT policy_id, cell, env_id, engine, integrator, dt, control_period, perturbation, arguments,
       training_discretization, training_seed, trace_every, float_width,
       seed - episode_index AS first_seed, rng_key = seed || '/0' AS first_of_seed,
       (reward IS NULL) = (episode_index % trace_every = 0) AS traceless, count(*) AS records
FROM records WHERE phase = 'evaluation' GROUP BY ALL ORDER BY policy_id, cell
"""

_TRAINING = """
SELECT policy_id, cell, env_id, arguments, training_discretization, training_seed, trace_every,
       float_width, seed IS NULL AS unseeded,
       (reward IS NULL) = (episode_index % trace_every = 0) AS traceless, count(*) AS records
FROM records WHERE phase = 'training' GROUP BY ALL ORDER BY policy_id
"""

_LANES = """
SELECT policy_id, seed, rng_key, episode_index FROM records
WHERE phase = 'training' ORDER BY policy_id, episode_index
"""

BASE = ("python", *(name for name in OF_EVERY_RUN if name != "scipy"))
"""Packages whose versions every record and every side-car has."""

_VERSIONS = """
SELECT package_versions, phase = 'training' AS trained, count(*) AS records, engine, engine_version,
       CASE WHEN perturbation LIKE '%"packages"%' THEN perturbation END AS perturbation
FROM records GROUP BY ALL ORDER BY 1
"""

_PARSED = ("perturbation", "training_discretization")


def planned_policies(plan: Mapping[str, Any], spec: PanelSpec) -> dict[str, Unit]:
    """The policies that a plan says will be evaluated, by id.

    Raises:
        SpecError: for an evaluation that does not say its policy's home.
    """
    found = {unit.policy: unit for unit in units_of(spec)}
    if "policy" in plan:
        name = spec.name.removeprefix("evaluate ")
        return {name: Unit(name, read_planned_home(plan)), **found}
    return found


_ELSEWHERE = ("card_hash", "content_hash", "format", "last_episodes", "platform", "versions")
"""What a side-car says that is checked in other ways, or not at all."""

_WRITERS = ("stable-baselines3", "torch", "jaxlib")
"""Packages whose versions a side-car may have where they decide no result."""

_EPISODES = """
SELECT policy_id, "return" AS returned, success FROM records WHERE phase = 'training'
ORDER BY policy_id, episode_index
"""

_SINGLE = Tolerance(1e-5)
"""Trainers average returns in 32 bits."""


@dataclass(frozen=True)
class PlannedRun:
    """A run, and what its plan says of it.

    Attributes:
        directory: of the run.
        plan: the `specification` of its manifest.
        spec: that this describes.
        versions: of its manifest.
        policies: that will be evaluated, by id.
        units: of training, by the policy that they train.
        found: where each policy was evaluated.
        can_load: whether environments of the plan may be made here, which loads code that it names.
    """

    directory: RunDirectory
    plan: Mapping[str, Any]
    spec: PanelSpec
    versions: Mapping[str, str]
    policies: Mapping[str, Unit]
    units: Mapping[str, Unit]
    found: Mapping[str, Evaluated]
    can_load: bool

    @cached_property
    def store(self) -> EvidenceStore:
        """Its records."""
        return EvidenceStore(self.directory.evidence)

    def training_faults(
        self, folder: Path, card: Mapping[str, Any], unit: Unit, marker: Mapping[str, Any]
    ) -> Iterator[Finding]:
        """What the files of a training unit say, and its plan and its records do not.

        Args:
            folder: of the policy.
            card: its side-car.
            unit: that trained it.
            marker: of that unit.
        """
        expected = self._card(unit, float(marker["seconds"])) | _of_files(folder)
        stated: Any = {name: x for name, x in card.items() if name not in _ELSEWHERE}
        if "units" not in expected:
            stated = _common(stated, expected)
        name = f"policies/{folder.name}"
        file = f"{name}/policy.json"
        yield from deny(file, None, "", stated, expected)
        versions = card.get("versions")
        yield from deny(file, None, "versions", versions, self._versions_beside(versions))
        last = self._last_episodes(unit.policy)
        if last is not None:
            stated = card.get("last_episodes")
            yield from deny(file, None, "last_episodes", stated, last, tolerance=_SINGLE)
        if (folder / POLICY_FILE).exists() and (folder / WEIGHTS_FILE).exists():
            for words in zip_faults(folder / POLICY_FILE, folder / WEIGHTS_FILE):
                yield Finding(f"{name}/{POLICY_FILE}", None, words)
        wanted = planned_key(
            self.versions,
            engine_versions({home.engine for home in unit.home.shares} if unit.home else ()),
            config=asdict(training_config(self.spec, unit)),
        )
        yield from deny(f"units/{unit.training}.json", None, "key", marker["key"], wanted)

    def _card(self, unit: Unit, seconds: float) -> dict[str, Any]:
        """A unit's side-car, or what of it follows where no environment can be made here."""
        spec = self.spec
        config: Any = training_config(spec, unit)
        made: dict[str, Any]
        native = {home.engine for home in spec.trained_on()} <= {NATIVE}
        if self.can_load and native and is_integ_environment(spec.env_id):
            mixture = _train_on(config)
            made = make_card(config, mixture, spec.trainer, seconds, {})
            made["action_bounds"] = _bounds(mixture.setups[0].action_space)
            for member in filter(None, (made["discretization"], *(made["mixture"] or ()))):
                member["engine_version"] = self.versions["integ-gym"]
        else:
            made = {
                "algorithm": config.algorithm,
                "trainer": spec.trainer,
                "env_id": spec.env_id,
                "seed": unit.seed,
                "config": asdict(config),
                "steps": config.rounded_steps,
                "wall_seconds": seconds,
            }
            if "mixture" not in config.env_arguments:
                given = config.env_arguments
                made["discretization"] = {name: given[name] for name in DISCRETIZATION}
        return {name: x for name, x in made.items() if name not in _ELSEWHERE}

    def _versions_beside(self, stated: Any) -> dict[str, Any]:
        """Versions that a side-car must tell; where they decide no result, those that it tells."""
        known = stated if isinstance(stated, Mapping) else {}
        free = {n: x for n, x in known.items() if n in _WRITERS and n not in self.versions}
        needed = (*known, *BASE, *TRAINERS[self.spec.trainer])
        return {**{n: self.versions.get(n) for n in needed}, **free}

    def _last_episodes(self, policy: str) -> dict[str, Any] | None:
        """Their number, and the means of what they came to; None where one is not finite."""
        last = self._episodes[policy][-LAST_EPISODES:]
        returns = [x for x, _ in last if x is not None]
        if len(returns) < len(last):
            return None
        successes = [float(x) for _, x in last if x is not None]
        return {**episode_summary(returns, successes), "exploring": True}

    @cached_property
    def _episodes(self) -> Mapping[str, list[tuple[Any, Any]]]:
        found = defaultdict(list)
        for row in self.store.query(_EPISODES).to_pylist():
            found[row["policy_id"]].append((row["returned"], row["success"]))
        return found


def of_setups(run: PlannedRun) -> Iterator[Finding]:
    """Records of other setups or starts than were planned, or without the trace that they have."""
    spec, policies = run.spec, run.policies
    rows = [row for row in run.store.query(_SETUPS).to_pylist() if row["policy_id"] in policies]
    homes = dict.fromkeys(policy.home for policy in policies.values())
    cells = spec.cells_by_name(homes) if run.can_load else {}
    setups: dict[str, dict[str, Any] | None] = {}
    for row in rows:
        where = f"{row['records']} records of policy {row['policy_id']!r} in cell {row['cell']!r}"
        expected: dict[str, Any] = {"trace_every": spec.trace_every, "traceless": False}
        cell = cells.get(row["cell"])
        if cell is not None:
            expected |= _plan_arguments(spec, policies[row["policy_id"]], cell)
        if cell is not None and row["engine"] == NATIVE and is_integ_environment(spec.env_id):
            if cell.name not in setups:
                setups[cell.name] = recorded_arguments(setup_of(spec.testbed, cell))
            expected |= {"arguments": setups[cell.name], "float_width": 64, "first_of_seed": True}
        yield from _check_fields(row, expected, where)


def of_training(run: PlannedRun) -> Iterator[Finding]:
    """Training records of other setups or starts than were planned, or without their trace."""
    spec, made = run.spec, dict[str, list[dict[str, Any]]]()
    for row in run.store.query(_TRAINING).to_pylist():
        policy = row["policy_id"]
        where = f"{row['records']} training records of policy {policy!r}"
        unit = run.units.get(policy)
        if unit is None or unit.home is None:
            yield Finding("evidence", None, f"{where}, which the plan does not train")
            continue
        config: Any = training_config(spec, unit)
        expected = {
            "cell": unit.training,
            "env_id": spec.env_id,
            "training_discretization": unit.home.arguments(),
            "training_seed": unit.seed,
            "trace_every": config.trace_every,
            "traceless": False,
            "unseeded": spec.trainer == "fleet",
        }
        native = {home.engine for home in unit.home.shares} == {NATIVE}
        if run.can_load and native and is_integ_environment(spec.env_id):
            if policy not in made:
                made[policy] = list(map(recorded_arguments, _train_on(config).setups))
            row_arguments: Any = None
            with suppress(EvidenceError):
                row_arguments = argument_values(row["arguments"])
            nearest = min(
                made[policy], key=lambda one: len([*find_differences("", row_arguments, one)])
            )
            expected |= {"arguments": nearest, "float_width": 32 if spec.trainer == "fleet" else 64}
        yield from _check_fields(row, expected, where)
    yield from _of_lanes(run)


def _train_on(config: Any) -> Mixture:
    """What a run trains on."""
    env = gym.make_vec(
        config.env_id, 1, vectorization_mode="vector_entry_point", **config.env_arguments
    )
    with closing(env):
        return mixture_of(env)


def _of_lanes(run: PlannedRun) -> Iterator[Finding]:
    """Training episodes of generators that no environment of the run has, or twice of one."""
    spec, seen = run.spec, dict[str, set[str]]()
    for row in run.store.query(_LANES).to_pylist():
        unit = run.units.get(row["policy_id"])
        if unit is None or unit.home is None:
            continue
        config: Any = training_config(spec, unit)
        lanes = range(config.n_envs)
        if spec.trainer == "fleet":
            known = {f"fleet-{unit.seed}-{lane}" for lane in lanes}
            seeded = row["seed"] is None
        else:
            known = {str(config.first_lane_seed + lane) for lane in lanes}
            seeded = f"{row['seed']}" == str(row["rng_key"]).partition("/")[0]
        name, _, number = str(row["rng_key"]).partition("/")
        own = seen.setdefault(row["policy_id"], set())
        fresh = number.isdecimal() and row["rng_key"] not in own
        own.add(row["rng_key"])
        if not (name in known and seeded and fresh):
            whose = f"training episode {row['episode_index']} of policy {row['policy_id']!r}"
            yield Finding("evidence", None, f"{whose} has no generator of its run's environments")


def of_versions(versions: Mapping[str, str], store: EvidenceStore) -> Iterator[Finding]:
    """Records of other versions than the manifest's, or without one that others like them have.

    In cells with other package versions those are expected in place of the manifest's.
    """
    read: list[tuple[Any, Any, dict[str, str]]] = []
    named: dict[tuple[bool, str | None], set[str]] = {}
    for row in store.query(_VERSIONS).to_pylist():
        try:
            recorded = parse_field("package_versions", row["package_versions"])
            changes = parse_field("perturbation", row["perturbation"]) or {}
            changed = versions_of(parse_packages(changes[PACKAGES])) if PACKAGES in changes else {}
        except ValueError as error:
            yield Finding("evidence", None, f"{row['records']} records: {error}")
            continue
        read.append((row, recorded, changed))
        own = named.setdefault((row["trained"], row["perturbation"]), {*BASE, *changed})
        own.update(recorded)
    for row, recorded, changed in read:
        there = {**versions, **changed}
        names = sorted(named[row["trained"], row["perturbation"]])
        expected: dict[str, Any] = {"package_versions": {name: there.get(name) for name in names}}
        if changed and row["engine"] in changed:
            expected["engine_version"] = changed[row["engine"]]
        said, where = {**row, "package_versions": recorded}, f"{row['records']} records"
        yield from _check_fields(said, expected, where)


def _check_fields(
    row: Mapping[str, Any], expected: Mapping[str, Any], where: str
) -> Iterator[Finding]:
    """What records alike say, and the plan does not."""
    for name, wanted in expected.items():
        try:
            recorded = _read(name, row)
        except EvidenceError as error:
            yield Finding("evidence", None, f"{where}: {error}")
            continue
        yield from deny("evidence", None, name, recorded, wanted, where=where)


def _plan_arguments(spec: PanelSpec, policy: Unit, cell: Cell) -> dict[str, Any]:
    given = cell.arguments(spec.environment)
    starts = spec.start_sets[0] if policy.seed is None else policy.seed
    return {
        "env_id": spec.env_id,
        **{name: given[name] for name in DISCRETIZATION},
        "perturbation": cell.environment or None,
        "training_discretization": policy.home.arguments() if policy.home else None,
        "training_seed": policy.seed,
        "first_seed": spec.start_seed(starts, 0),
    }


def _read(name: str, row: Mapping[str, Any]) -> Any:
    """A column's value, of text that holds JSON what it says.

    Raises:
        EvidenceError: for text that is not of its form.
    """
    if name == "arguments":
        return argument_values(row[name])
    return parse_field(name, row[name]) if name in _PARSED else row[name]


def planned_key(versions: Mapping[str, str], engines: Iterable[str], **parts: Any) -> str:
    """Key of a unit's inputs under the versions of its run's manifest.

    Args:
        versions: of the manifest.
        engines: packages of foreign engines that the unit depends on.
        parts: see :func:`integ_gym.eval.panel.run_directory.key_of`.
    """
    names = ("python", *OF_EVERY_RUN, *engines)
    return key_of({name: versions.get(name, "missing") for name in names}, **parts)


def _of_files(folder: Path) -> dict[str, Any]:
    """What a side-car says of the files beside it."""
    file = folder / POLICY_FILE
    recorded = {
        "policy_file": POLICY_FILE if file.exists() else WEIGHTS_FILE,
        "weights_file": WEIGHTS_FILE,
    }
    if file.exists():
        recorded["zip_hash"] = hashlib.sha256(file.read_bytes()).hexdigest()
    return recorded


def _bounds(space: Any) -> Any:
    return [space.low.tolist(), space.high.tolist()] if isinstance(space, spaces.Box) else None


def _common(stated: Any, expected: Any) -> Any:
    """The values under expected keys."""
    if not (isinstance(stated, Mapping) and isinstance(expected, Mapping)):
        return stated
    return {name: _common(stated.get(name), wanted) for name, wanted in expected.items()}
