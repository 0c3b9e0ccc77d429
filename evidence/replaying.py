"""Episodes simulated again, held against their records, and what of a run is missing."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, groupby, islice
from operator import itemgetter
from typing import Any

import gymnasium as gym
import numpy as np

from integ_gym.envs.environment import is_integ_environment
from integ_gym.envs.foreign import ForeignSetup
from integ_gym.envs.ops.ops import Array
from integ_gym.envs.rediscretized import plant_of
from integ_gym.envs.registries import ENVIRONMENTS, TESTBEDS
from integ_gym.envs.settings import DISCRETIZATION, DRAWN, NATIVE, Discretization
from integ_gym.envs.tasks.interface import to_public_order
from integ_gym.envs.testbeds.gym_testbed import ClassicControl, class_path
from integ_gym.envs.testbeds.making import MujocoTestbed, find_testbed, make_checked
from integ_gym.envs.testbeds.mjcf import MjcfTestbed
from integ_gym.support import interpreters
from integ_gym.support.optional import package_version
from integ_gym.support.parameters import texts_of
from integ_gym.support.terminal import plural

from . import recomputing
from .episodes import choices, native_setup
from .fields import FIRST_WRITTEN, LATER_ATTEMPT, SCHEMA_VERSION, SECOND_HORIZON, record_fields
from .parquet_file import check_schema, read
from .record import EvidenceRecord, records_of
from .schema import ENV_KEY, VERSION_KEY, EvidenceError, Finding, described, parse_field
from .store import EvidenceStore
from .vector_recorder import RecordVectorEvidence

ELSEWHERE = 1e-6
"""Relative tolerance where other versions, another processor or another engine computed."""

NUDGE, DECIDED_NUDGE = 1e-12, 1e-6
"""By how much a start is moved, relative to the larger of 1 and itself, to see what rounding grows
to: that of a recorded motion in 64 bits, and of a network's decisions in 32 bits."""

INEXACT = 0.1
"""Share of a file's records that may deviate within the tolerance and still be findings."""

Acting = Callable[[Array], Any]
"""From observations of shape (n, obs_dim) to n actions, of one policy in episodes that begin."""

_OWN_CODE = "made with the user's own code, see --own-code"

_LOST_ACTIONS = (
    "that come out otherwise, and whose actions were beyond their bounds, which alone are kept"
)

UNDECIDED = "of training or of a policy without a hash, whose controls are unknown"

MOST_LANES = 512
"""Episodes that are played side by side."""


@dataclass
class Replayed:
    """What came of replays.

    Attributes:
        records: that were played again.
        exact: of them, those that came out the same to the last bit.
        findings: what deviated.
        sensitive: what deviated of records which rounding alone changes as much.
        close: the first that deviated within the tolerance in each record of our own engine, by
            file.
        of_file: records that were played again, by file.
        skipped: reason to number of records that were not.
        undecided: the same of those whose trace leaves open whether the fallback acted, and whose
            policy did not decide again.
    """

    records: int = 0
    exact: int = 0
    findings: list[Finding] = field(default_factory=list)
    sensitive: list[list[Finding]] = field(default_factory=list)
    close: dict[str, list[Finding]] = field(default_factory=dict)
    of_file: Counter[str] = field(default_factory=Counter)
    skipped: Counter[str] = field(default_factory=Counter)
    undecided: Counter[str] = field(default_factory=Counter)

    def add(self, other: Replayed) -> None:
        """Count what came of further records."""
        self.records += other.records
        self.exact += other.exact
        self.findings += other.findings
        self.sensitive += other.sensitive
        for file, found in other.close.items():
            self.close.setdefault(file, []).extend(found)
        self.of_file += other.of_file
        self.skipped += other.skipped

    def settle(self) -> Replayed:
        """Judge what deviates by how much of the rest came out to the last bit.

        Where most did, this machine computes as the one that made the records did, and rounding is
        no excuse. A file is made by one process; where nearly all of it comes out to the last bit,
        neither is the tolerance.
        """
        if 2 * self.exact >= self.records:
            self.findings += chain.from_iterable(self.sensitive)
            self.sensitive.clear()
        for file, found in list(self.close.items()):
            if len(found) <= INEXACT * self.of_file[file]:
                self.findings += self.close.pop(file)
        return self


def replay(
    records: Sequence[tuple[str, EvidenceRecord]],
    *,
    exact: bool = False,
    own_code: bool = False,
    policy: Callable[[EvidenceRecord], Acting] | None = None,
    report: Callable[[int], object] = lambda count: None,
    done: Replayed | None = None,
) -> Replayed:
    """Play episodes again from their first states, with the controls of their traces.

    Differences that rounding alone explains, as a start moved by :data:`NUDGE` shows, are listed
    apart; :meth:`Replayed.settle` is to be called when all are played.

    Args:
        records: file and record.
        exact: whether every bit must be the same, and not numbers within `ELSEWHERE`.
        own_code: whether classes that a record names as ``"module:Class"`` may be loaded.
        policy: what acted in a record, which then decides again; a `ValueError` says that it
            cannot be had. Its decisions are the same to the last bit where all its episodes of a
            cell are among ``records``, for it sees them together. It is pickled for records of
            other package versions.
        report: called now and then with the number of further ``records`` that are done.
        done: what came of other records, to which these are added.
    """
    done = Replayed() if done is None else done
    here, elsewhere = _by_packages(records)
    how = {"exact": exact, "own_code": own_code, "policy": policy}
    for packages, of_them in elsewhere.items():
        _replay_there(packages, of_them, how, done)
        report(len(of_them))
    able = []
    for file, record in here:
        try:
            reason = _hindrance(record, own_code, policy is not None)
            if reason is None:
                recomputing.context_of(record.fields)
        except recomputing.UNFIT as error:
            name = str(record.fields["record_id"])
            done.findings.append(Finding(file, name, f"cannot be played again: {_line(error)}"))
            continue
        if reason is None:
            able.append((file, record))
        else:
            done.skipped[reason] += 1
    report(len(here) - len(able))
    own = ("env_id", "arguments", "cell", "policy_id", "policy_hash")
    key = itemgetter(*(own[:2] if policy is None else own))
    able.sort(key=lambda item: key(item[1].fields))
    for _, group in groupby(able, lambda item: key(item[1].fields)):
        alike = sorted(group, key=lambda item: item[1].fields["episode_index"])
        lanes = MOST_LANES if policy is None else len(alike)
        for first in range(0, len(alike), lanes):
            together = alike[first : first + lanes]
            _play(together, exact, done, policy)
            report(len(together))
    return done


def packages_of(record: EvidenceRecord) -> tuple[str, ...]:
    """Package versions of the record's cell that are not those of this interpreter.

    Raises:
        EvidenceError, ValueError: for a damaged field.
    """
    changed = parse_field("perturbation", record.fields["perturbation"]) or {}
    if interpreters.PACKAGES not in changed:
        return ()
    packages = interpreters.parse_packages(changed[interpreters.PACKAGES])
    return () if interpreters.are_running(packages) else packages


def versions_for_replay(records: Iterable[EvidenceRecord]) -> dict[str, str]:
    """Versions, as they are here, of what is imported where records are played again."""
    names = {
        name
        for fields in (record.fields for record in records)
        for name in (fields["env_id"].partition(":")[0], str(fields["engine"]))
    }
    return interpreters.needed_versions(sorted(names))


Named = tuple[str, EvidenceRecord]


def _by_packages(
    records: Iterable[Named],
) -> tuple[list[Named], dict[tuple[str, ...], list[Named]]]:
    """Records that are played here, and those of other package versions by these."""
    here: list[Named] = []
    elsewhere: dict[tuple[str, ...], list[Named]] = {}
    for item in records:
        try:
            packages = packages_of(item[1])
        except ValueError:  # a damaged one is found as such here
            packages = ()
        (elsewhere.setdefault(packages, []) if packages else here).append(item)
    return here, elsewhere


def _replay_there(
    packages: tuple[str, ...], records: list[Named], how: dict[str, Any], done: Replayed
) -> None:
    """Play records again in the interpreter with their package versions, if it is there."""
    interpreter = interpreters.find_interpreter(
        packages, versions_for_replay(record for _, record in records)
    )
    if interpreter is None:
        reason = (
            f"of {' '.join(packages)}, with which there is no interpreter here: verify with "
            "--make-interpreters makes it"
        )
        done.skipped[reason] += len(records)
        return
    try:
        (found,) = interpreters.call_there(interpreter, _replay_records, records, how)
    except interpreters.InterpreterError as error:
        done.skipped[f"that cannot be played again: {_line(error)}"] += len(records)
        return
    done.add(found)


def _replay_records(records: Sequence[Named], how: dict[str, Any]) -> Iterator[Replayed]:
    yield replay(records, **how)


def records_by_packages(store: EvidenceStore) -> dict[tuple[str, ...], list[EvidenceRecord]]:
    """Package versions of cells that are not those of this interpreter, with records of each."""
    names = store.query(_VARIED).column("record_id").to_pylist()
    records = store.named_records(frozenset(names)) if names else ()
    _, elsewhere = _by_packages(records)
    return {packages: [record for _, record in own] for packages, own in elsewhere.items()}


_VARIED = f"""
SELECT any_value(record_id) AS record_id FROM records
WHERE perturbation LIKE '%"{interpreters.PACKAGES}"%' GROUP BY perturbation, env_id, engine
"""


def _hindrance(record: EvidenceRecord, own_code: bool, decided: bool) -> str | None:
    """Why a record cannot be played again here; None: it can."""
    fields = record.fields
    if ":" in fields["env_id"] and not own_code:
        return _OWN_CODE
    foreign = not is_integ_environment(fields["env_id"])
    if foreign and not _is_seeded(record):
        return "of an environment whose state cannot be set"
    if foreign and not recomputing.start_follows_seed(record):
        return "of training, whose starts are not drawn from seeds of their own"
    if not (record.trace or decided):
        return "without a trace"
    if decided and not fields["policy_hash"]:
        return UNDECIDED
    if decided and _has_lost_noise(record):
        return "whose noise cannot be drawn again"
    if recomputing.noise_source(record) is None and any(
        record.arguments().get(name) for name in DRAWN
    ):
        return "whose delays cannot be drawn again"
    if fields["float_width"] != 64 and not foreign and not _is_own_width(record):
        return "computed in 32 bits, which no environment here does"
    if not own_code and any(":" in text for text in texts_of(record.arguments())):
        return _OWN_CODE
    return None


def _is_own_width(record: EvidenceRecord) -> bool:
    """Whether environments here compute in a record's floats too, as those of its engine do."""
    if record.fields["phase"] == "training":
        return False
    described = parse_field("engine_description", record.fields["engine_description"]) or {}
    return bool(described.get("width") == record.fields["float_width"])


_SEEDED = tuple(class_path(kind) for kind in (MujocoTestbed, ClassicControl))
"""Testbeds whose environments start from their seeds alone, and follow from id and arguments."""


def _is_seeded(record: EvidenceRecord) -> bool:
    """Whether a testbed made it whose environments can be made and started again."""
    return _testbed_class(record) in _SEEDED or _is_of_robot(record)


def _is_of_robot(record: EvidenceRecord) -> bool:
    """Whether a testbed of the user's own robot made it, whose code is loaded."""
    env_id = record.fields["env_id"]
    return _testbed_class(record) == env_id and issubclass(TESTBEDS.load(env_id), MjcfTestbed)


def _testbed_class(record: EvidenceRecord) -> Any:
    """The class of the testbed that made it; None: none did."""
    return parse_field("engine_description", record.fields["engine_description"]).get("testbed")


def _has_lost_actions(record: EvidenceRecord) -> bool:
    """Whether an environment of others may have seen actions beyond the bounds that are kept."""
    saturated = record.fields["saturated_share"] or record.fields["fallback_count"]
    return bool(saturated) and not is_integ_environment(record.fields["env_id"])


def _has_lost_noise(record: EvidenceRecord) -> bool:
    """Whether it has sensor noise that cannot be drawn again."""
    return bool(record.fields["observation_noise"]) and recomputing.noise_source(record) is None


def _play(
    alike: Sequence[tuple[str, EvidenceRecord]],
    exact: bool,
    done: Replayed,
    policy: Callable[[EvidenceRecord], Acting] | None,
) -> None:
    """Play episodes of one setup side by side; those of one policy, if it decides."""
    records = [record for _, record in alike]
    decided, tolerance = policy is not None, 0.0 if exact else ELSEWHERE
    try:
        if policy is not None:
            policy(records[0])
    except (ModuleNotFoundError, ValueError) as error:
        done.skipped[f"whose policy cannot decide again: {_line(error)}"] += len(records)
        return
    try:
        env = _make_env(records)
    except (ModuleNotFoundError, TypeError, ValueError) as error:
        done.skipped[f"that cannot be made here: {_line(error)}"] += len(records)
        return
    try:
        played = _simulate(env, records, policy)
    except (LookupError, TypeError, ValueError) as error:
        message = f"cannot be played again from what it holds: {_line(error)}"
        names = ((file, str(record.fields["record_id"])) for file, record in alike)
        done.findings += [Finding(file, name, message) for file, name in names]
        return
    off = []
    for file, record in alike:
        done.records += 1
        done.of_file[file] += 1
        name = record.fields["record_id"]
        first = None
        if name in played:
            first = next(recomputing.differences(record, played[name], 0.0, decided), None)
            if first is None:
                done.exact += 1
                continue
        if first is None or any(recomputing.differences(record, played[name], tolerance, decided)):
            if not decided and _has_lost_actions(record):
                done.records -= 1
                done.skipped[_LOST_ACTIONS] += 1
                continue
            off.append((file, record))
        elif record.fields["engine"] == NATIVE:
            done.close.setdefault(file, []).append(recomputing.deviation(file, name, *first))
    nudged: dict[str, EvidenceRecord] = {}
    settable = is_integ_environment(records[0].fields["env_id"])
    if off and settable and not (exact or any(_has_lost_noise(record) for _, record in off)):
        nudged = _simulate(_make_env(records), records, policy, nudged=True)
    for file, record in off:
        name = str(record.fields["record_id"])
        again, other = played.get(name), nudged.get(name)
        if again is None:
            message = "the episode does not end within its length when it is played again"
            done.findings.append(Finding(file, name, message))
            continue
        found = [
            recomputing.deviation(file, name, *x)
            for x in recomputing.differences(record, again, tolerance, decided)
        ]
        if other is None or any(recomputing.differences(record, again, tolerance, decided, other)):
            done.findings += found
        else:
            done.sensitive.append(found)


def _line(error: Exception) -> str:
    return " ".join(str(error).split())


def _make_env(records: Sequence[EvidenceRecord]) -> Any:
    env_id, arguments = records[0].fields["env_id"], records[0].arguments()
    if not is_integ_environment(env_id):
        place = Discretization(**{name: arguments.pop(name) for name in DISCRETIZATION})
        if not _is_of_robot(records[0]):
            duration, home = arguments.pop("duration"), find_testbed(env_id, arguments).home
            limit = round(duration / home.control_period)
            if limit != gym.spec(env_id).max_episode_steps:  # which Gymnasium keeps out of kwargs
                arguments["max_episode_steps"] = limit
        return make_checked(find_testbed(env_id, arguments), place, len(records))
    return gym.make_vec(env_id, len(records), vectorization_mode="vector_entry_point", **arguments)


def _simulate(
    env: Any,
    records: Sequence[EvidenceRecord],
    policy: Callable[[EvidenceRecord], Acting] | None,
    nudged: bool = False,
) -> dict[str, EvidenceRecord]:
    """The records of the same episodes as they come out here, by id.

    Controls are those of the records, or what the policy decides. It sees the observations of our
    own environments together, on any engine, and those of others one by one, as when it was
    evaluated.
    """
    indices = [record.fields["episode_index"] for record in records]
    contexts = [recomputing.context_of(record.fields) for record in records]
    recorder = RecordVectorEvidence(env, "", contexts, episodes=indices, commit_on_close=False)
    setup = recorder.unwrapped.setup  # type: ignore[attr-defined]
    asked = _actions(setup, records) if policy is None else None
    together = is_integ_environment(records[0].fields["env_id"])
    acting = [] if policy is None else [policy(one) for one in records[: 1 if together else None]]
    nudge = (NUDGE if policy is None else DECIDED_NUDGE) if nudged else 0.0
    observation = _start(recorder, records, nudge)
    for step in range(max(record.fields["length"] for record in records)):
        if policy is None:
            actions = asked[:, step]  # type: ignore[index]
        else:
            seen = np.split(observation, len(acting))
            decided = zip(acting, seen, strict=True)
            parts = [np.asarray(act(part), dtype=np.float64) for act, part in decided]
            actions = np.concatenate(parts).reshape(recorder.action_space.shape)
        observation = recorder.step(actions)[0]
    replays = [{i: recomputing.replays_of(r.fields)} for i, r in zip(indices, records, strict=True)]
    table = recorder.take(replays)
    recorder.close()
    return {} if table is None else {r.fields["record_id"]: r for r in records_of(table)}


def play_substeps(record: EvidenceRecord, own_code: bool = False) -> dict[str, Array]:
    """What a robot did at every timestep of an episode, which is played again for it.

    Args:
        record: of the episode.
        own_code: see :func:`replay`.

    Returns:
        Time, s, positions, velocities and forces of actuators, SI units, contacts and iterations of
        the solver after each timestep, by name, shape (timesteps,).

    Raises:
        EvidenceError: if it cannot be played again here, or comes out otherwise.
    """
    found = _hindrance(record, own_code, decided=False)
    if found is None and not _is_of_robot(record):
        found = "of an environment whose timesteps are not known"
    if found is not None:
        raise EvidenceError(f"{record.fields['record_id']} is {found}; show another record")
    env, rows = _make_env([record]), []
    (robot,) = env.unwrapped.envs
    plant = plant_of(robot.mujoco, robot.model, "")

    def note(data: Any) -> None:
        solver = data.ncon, data.solver_niter.max()
        rows.append([data.time, *data.qpos, *data.qvel, *data.actuator_force, *solver])

    robot.ledger.note_steps(note)
    played = _simulate(env, [record], None).get(record.fields["record_id"])
    if played is None or any(recomputing.differences(record, played, 0.0, False)):
        raise EvidenceError(f"{record.fields['record_id']} comes out otherwise here")
    forces = [f"{name.removesuffix('_control')}_force" for name, _ in plant.controls]
    names = "time", *plant.coordinates, *plant.velocities, *forces, "contacts", "solver_iterations"
    return dict(zip(names, np.array(rows, np.float64).T, strict=True))


def _start(recorder: RecordVectorEvidence, records: Sequence[EvidenceRecord], nudge: float) -> Any:
    """First observations, from starts and noise that are drawn again where they can be."""
    if not nudge and all(map(recomputing.start_follows_seed, records)):
        return recorder.reset(seed=[record.fields["seed"] for record in records])[0]
    states = np.array([record.fields["initial_state"] for record in records])
    states = states + nudge * np.maximum(1.0, np.abs(states))
    noise = [recomputing.noise_source(record) or (None, 0) for record in records]
    environments: Any = recorder.unwrapped
    states = to_public_order(environments.setups[0].task, states)
    options = {"state": states, "episode": np.array([episode for _, episode in noise])}
    return recorder.reset(seed=[seed for seed, _ in noise], options=options)[0]


def _actions(setup: Any, records: Sequence[EvidenceRecord]) -> Array:
    """Actions that ask for the recorded controls, shape of the action space with all steps."""
    steps = max(record.fields["length"] for record in records)
    foreign = isinstance(setup, ForeignSetup)
    names = [name for name, _ in setup.plant.controls]
    asked = np.zeros((len(records), steps, len(names)))
    for lane, record in enumerate(records):
        for k, name in enumerate(names):
            asked[lane, : record.fields["length"], k] = record.trace[f"{name}_commanded"]
    if foreign:
        shape = () if setup.task.discrete is not None else setup.action_space.shape
        kind = setup.action_space.dtype
        return asked.reshape(*asked.shape[:2], *shape).astype(kind)
    if setup.task.discrete is None:
        return asked
    asked = asked[:, :, 0]
    actions = choices(setup.task, asked)
    for lane, record in enumerate(records):
        actions[lane, record.fields["length"] :] = 0.0
    return actions


_COUNTED = """
SELECT phase, cell, policy_id, policy_hash, min(episode_index) AS first, max(episode_index) AS last,
       count(DISTINCT episode_index) AS present, count(*) AS records
FROM records GROUP BY ALL HAVING present < last - first + 1 OR records > present
ORDER BY phase, cell, policy_id, policy_hash
"""


_OF_FAILURES = (SECOND_HORIZON, LATER_ATTEMPT)
"""Phases that hold the episodes alone that failed within one horizon."""


def missing_episodes(store: EvidenceStore, part: bool = False) -> Iterator[Finding]:
    """Cells in which episodes between the first and the last are missing, or there twice.

    Args:
        store: of the records.
        part: whether they are a part of a run's, of which some may be missing.
    """
    for row in store.query(_COUNTED).to_pylist():
        some = part or row["phase"] in _OF_FAILURES
        missing = 0 if some else row["last"] - row["first"] + 1 - row["present"]
        twice = row["records"] - row["present"]
        episodes = f"of episodes {row['first']} to {row['last']}"
        counts = [f"{missing} missing {episodes}"] if missing else []
        counts += [f"{plural(twice, 'record')} too many {episodes}"] if twice else []
        if counts:
            where = f"cell {row['cell']!r}, policy {row['policy_id']!r}"
            yield Finding(where, None, ", ".join(counts))


_MEANT = ("unit", "frame", "at")
"""What a column's metadata says of its numbers; the rest are words."""


def other_columns(store: EvidenceStore) -> Iterator[Finding]:
    """Columns of our own environments whose unit, frame or place in time is stated otherwise.

    Files of earlier schema versions are left out; of records that say that this version of
    integ-gym made them, an earlier schema version is found.

    Raises:
        EvidenceError: for a file that cannot be read.
    """
    for file in store.files():
        schema = check_schema(file)
        metadata = {key.decode(): value.decode() for key, value in schema.metadata.items()}
        rows = read(file, columns=["env_id", "arguments", "schema_version", "package_versions"])
        for name, key in (("env_id", ENV_KEY), ("schema_version", VERSION_KEY)):
            said = metadata.get(key.decode())
            if any(str(value) != said for value in set(rows.column(name).to_pylist())):
                yield Finding(file.name, None, f"its metadata say {name} {said!r}, its records not")
        version, present = metadata[VERSION_KEY.decode()], package_version("integ-gym")
        makers = map(_maker, set(rows.column("package_versions").to_pylist()))
        if int(version) < FIRST_WRITTEN and present in makers:
            message = (
                f"it has schema version {version}, and its records say that integ-gym {present} "
                f"made them, which writes {SCHEMA_VERSION}"
            )
            yield Finding(file.name, None, message)
        env_id = metadata.get(ENV_KEY.decode(), "")
        if int(version) < FIRST_WRITTEN or env_id not in ENVIRONMENTS:
            continue
        setup = native_setup(env_id, rows.column("arguments")[0].as_py())
        for own in record_fields(setup.plant, setup.task):
            if own.since > int(version):
                continue
            found = described(schema.field(own.name)) if own.name in schema.names else {}
            for about in _MEANT:
                said, wanted = found.get(about), getattr(own, about)
                if said != wanted:
                    message = f"column {own.name}: {about} is {said!r}, not {wanted!r}"
                    yield Finding(file.name, None, message)


def _maker(package_versions: str) -> str | None:
    """Version of integ-gym that made a record; None where it does not say."""
    try:
        return str(parse_field("package_versions", package_versions)["integ-gym"])
    except (EvidenceError, LookupError, TypeError):
        return None


BLOCK = 4096
"""Records that are in memory at once; those of one setup are played side by side."""

_TRACED = "SELECT record_id FROM records WHERE reward IS NOT NULL ORDER BY record_id"
_CELLS = """
SELECT list(record_id ORDER BY episode_index) AS ids,
       coalesce(list(record_id) FILTER (reward IS NULL), []) AS untraced
FROM records WHERE policy_hash <> ''
GROUP BY env_id, policy_id, policy_hash, cell, phase ORDER BY policy_hash, policy_id, cell, phase
"""

_HOPELESS = "SELECT record_id FROM records WHERE policy_hash = ''"


def replay_some(
    store: EvidenceStore,
    count: int | None,
    chance: random.Random,
    policy: Callable[[EvidenceRecord], Acting],
    *,
    decide: bool = False,
    exact: bool = False,
    own_code: bool = False,
    report: Callable[[int], object] = lambda count: None,
) -> Replayed:
    """Play records of a run again: with recorded controls, or without a trace by their policy.

    Of records without a trace all episodes of a policy in a cell are played, which it sees
    together; those among them that have one are held against it. Where a trace leaves open whether
    the fallback acted in place of a policy, that decides again too.

    Args:
        store: of the run.
        count: how many, about; None: all.
        chance: draws them.
        policy: see :func:`replay`.
        decide: let the policies decide again where there are traces, too.
        exact: see :func:`replay`.
        own_code: see :func:`replay`.
        report: see :func:`replay`.
    """
    repeated, decided = _draw(store, count, chance, decide)
    done, of_policies = Replayed(), Replayed()
    again = partial(replay, exact=exact, own_code=own_code)
    records = store.named_records(repeated) if repeated else iter(())
    unsaid: set[str] = set()
    while block := list(islice(records, BLOCK)):
        again(block, report=report, done=done)
        unsaid.update(
            record.fields["record_id"]
            for _, record in block
            if record.fields["policy_hash"]
            and record.fields["fallback_count"] is not None
            and recomputing.may_have_fallen_back(record)
        )
    for of_file in _by_file(store, decided):
        again(of_file, policy=policy, report=report, done=done)
    for of_file in _by_file(store, _together(store, unsaid)):
        again(of_file, policy=policy, done=of_policies)
    bare = "" if decide else " AND reward IS NULL"
    done.skipped[UNDECIDED] += store.query(_HOPELESS + bare).num_rows
    done.findings += of_policies.settle().findings
    done.undecided = of_policies.skipped
    return done.settle()


def _by_file(store: EvidenceStore, names: Set[str]) -> Iterator[list[Named]]:
    """Records of those ids, file by file, which holds all of a cell's episodes."""
    records = store.named_records(frozenset(names)) if names else iter(())
    for _, of_file in groupby(records, key=itemgetter(0)):
        yield list(of_file)


def _together(store: EvidenceStore, names: Set[str]) -> set[str]:
    """All records of the policies' cells in which one of those ids is."""
    cells = store.query(_CELLS).column("ids").to_pylist() if names else []
    return {name for ids in cells if not names.isdisjoint(ids) for name in ids}


def _draw(
    store: EvidenceStore, count: int | None, chance: random.Random, decide: bool
) -> tuple[frozenset[str], frozenset[str]]:
    """Ids of records that are played with the controls of their traces, and by their policy.

    Of the latter there are whole cells, until there are enough of their records.
    """
    own = "ids" if decide else "untraced"
    cells = [cell for cell in store.query(_CELLS).to_pylist() if cell[own]]
    traced = [] if decide else store.query(_TRACED).column("record_id").to_pylist()
    wanted = sum(len(cell[own]) for cell in cells)
    share = 1.0 if count is None else min(1.0, count / max(1, len(traced) + wanted))
    chance.shuffle(cells)
    decided: set[str] = set()
    drawn = 0
    for cell in cells:
        if drawn < share * wanted:
            decided.update(cell["ids"])
            drawn += len(cell[own])
    rest = [name for name in traced if name not in decided]
    repeated = chance.sample(rest, min(len(rest), round(share * len(traced))))
    return frozenset(repeated), frozenset(decided)
