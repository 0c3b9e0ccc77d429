"""Policies that exist already: from a file, an object, a function, or the records of a run."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from integ_gym.envs.environment import environment_setup, is_integ_environment
from integ_gym.envs.lanes import DiscretizedVectorEnv
from integ_gym.envs.testbeds.making import find_testbed, make_training_environments
from integ_gym.envs.testbeds.mjcf import model_arguments
from integ_gym.evidence.record import EvidenceRecord
from integ_gym.evidence.replaying import Acting
from integ_gym.evidence.schema import argument_values
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.errors import InputError
from integ_gym.support.files import read_object
from integ_gym.train.baselines import BASELINES, make_baseline
from integ_gym.train.monitoring import RawModel
from integ_gym.train.policy import CalledPolicy, MlpPolicy, Policy, behaviour_hash, start_acting
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.onnx import onnx_card, onnx_data
from integ_gym.train.policy_files.programs import ProgramPolicy, TorchScriptPolicy
from integ_gym.train.policy_files.reading import ONNX_ENDING, POLICY_ENDINGS, read_weights, unscaled
from integ_gym.train.policy_files.sb3_zip import lacks_statistics, read_sb3_model
from integ_gym.train.policy_files.sidecar import Stated, has_sidecar, read_trained, readable_file

from .cells import Home, nominal_setup
from .home import VARIED, Provenance, provenance


@dataclass(frozen=True)
class Existing:
    """A policy and what is known of its training.

    Attributes:
        policy: what acts.
        provenance: where it comes from.
        files: what it was read from, by the name to keep it under.
        seed: of its training, where it is known.
        action_space: of the environment that it is judged in; None: not known.
        unscaled: whether it learned from scaled observations, and is given them as they are.
    """

    policy: Policy
    provenance: Provenance
    files: Mapping[str, Path]
    seed: int | None
    action_space: spaces.Space[Any] | None = None
    unscaled: bool = False

    @property
    def home(self) -> Home | None:
        """Discretization or mixture that it was trained on; None: unknown."""
        return self.provenance.home

    @property
    def stated_home(self) -> dict[str, Any]:
        """What a panel's specification says of its home; null where that is unknown."""
        shares = {} if self.home is None else self.home.shares
        members = [one.arguments() for one in shares] or None
        home = {"discretizations": members, "origin": self.provenance.origin}
        return {**home, "shares": list(shares.values())} if len(shares) > 1 else home


def read_existing(
    path: Path,
    env_id: str,
    given: Mapping[str, Any],
    obs_stats: Path | None = None,
    own_code: bool = False,
    home: Stated = None,
) -> Existing:
    """A policy from its file, with what its side-car, the JSON file of the same name, says of it.

    Without a side-car, its home is what is stated, or unknown.

    Args:
        path: of its file.
        env_id: environment to evaluate in.
        given: environment arguments that override those of its training; not the discretization,
            which is what the evaluation varies.
        obs_stats: VecNormalize's statistics, as its pickle or as JSON.
        own_code: whether a class that the side-car names as ``"module:Class"`` may be loaded, and
            a TorchScript program run.
        home: what it was trained on.

    Raises:
        PolicyFileError: for a file that cannot be read, or a side-car of another policy.
        TypeError, ValueError: see :func:`~integ_gym.eval.panel.home.provenance`.
    """
    read, card, files = read_policy_file(path, obs_stats)
    known, environments = provenance(env_id, card, home, given, own_code)
    if isinstance(read, TorchScriptPolicy) and not own_code:
        raise PolicyFileError(
            f"{path}: is a TorchScript program, whose code would be run; if you trust it, pass "
            "--own-code, or export it with torch.onnx.export"
        )
    policy = fitted(read, environments)
    name, seed = (path.stem, None)
    if card is not None:
        name, seed = str(card.get("policy_id", name)), card.get("seed")
    bare = obs_stats is None and unscaled(path, card)
    space = environments.single_action_space
    return Existing(replace(policy, policy_id=row_name(name)), known, files, seed, space, bare)


def read_policy_file(path: Path, obs_stats: Path | None = None) -> tuple[Any, Any, dict[str, Path]]:
    """The policy, what its side-car or metadata says, and the files by the name to keep them.

    Raises:
        PolicyFileError: for a file that cannot be read, or a side-car of another policy.
    """
    files = {f"policy{path.suffix.lower()}": path}
    if obs_stats is not None:
        files[f"obs_stats{obs_stats.suffix}"] = obs_stats
    card = None
    if path.suffix.lower() == ONNX_ENDING:
        card = onnx_card(path)
        files |= {data.name: data for data in onnx_data(path)}
    if not has_sidecar(path):
        return read_weights(path, None, obs_stats), card, files
    files["policy.json"] = path.with_suffix(".json")
    policy, own = read_trained(path)
    if card is not None and card.get("home") is not None and card["config"] != own.get("config"):
        raise PolicyFileError(
            f"{path}: its metadata and its side-car describe different trainings; move the "
            "wrong one away"
        )
    return (policy if obs_stats is None else read_weights(path, own, obs_stats)), own, files


def find_policy(folder: Path) -> tuple[Path, Path | None] | None:
    """File and observation statistics of a policy in its folder of a run; None without a file."""
    found = (readable_file(folder), *(folder / f"policy{ending}" for ending in POLICY_ENDINGS))
    file = next((path for path in found if path.exists()), None)
    return None if file is None else (file, next(folder.glob("obs_stats.*"), None))


def hashes_of(folder: Path) -> set[str]:
    """Hash that the policy in a folder of a run has in evidence; empty without a file.

    Raises:
        PolicyFileError: see :func:`read_policy_file`.
    """
    kept = find_policy(folder)
    return set() if kept is None else {read_policy_file(*kept)[0].content_hash}


def fitted(policy: Any, environments: DiscretizedVectorEnv) -> Any:
    """A policy for these environments, whose spaces it is checked against.

    A program's outputs are values of actions where these are discrete, and its inputs may be parts
    of the observation.

    Raises:
        ValueError: if it cannot act there.
    """
    action_space = environments.single_action_space
    if isinstance(policy, ProgramPolicy):
        names = environments.setups[0].task.observation_names
        discrete = isinstance(action_space, spaces.Discrete)
        policy = replace(policy, discrete=discrete, names=names)
    policy.check_spaces(environments.single_observation_space, action_space)
    return policy


def row_name(name: str) -> str:
    """A policy's name as that of its row and files, kept apart from the baselines'."""
    usable = re.sub(r"[^A-Za-z0-9._]+", "-", name).strip("-._")[:100] or "policy"
    return f"policy-{usable}" if usable in BASELINES else usable


LANES, STEPS = 8, 16
"""Environments and decisions of the observations that a policy is known by."""

_REFERENCE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*")


def is_reference(given: Any) -> bool:
    """Whether this names code, ``"module:function"``."""
    return isinstance(given, str) and _REFERENCE.fullmatch(given) is not None


def given_policy(
    given: Any, env_id: str, environment: Mapping[str, Any], home: Stated = None
) -> Existing:
    """What is known of a policy that an object is.

    Args:
        given: anything callable, from one observation to one action; anything with ``predict``,
            such as a model of stable-baselines3; a policy with ``act``; or ``"module:name"`` of
            one, of which a class is made without arguments.
        env_id: environment to evaluate in.
        environment: environment arguments of its training; not the discretization.
        home: what it was trained on.

    Raises:
        TypeError, ValueError: for what cannot be asked for actions, or for a home that cannot be;
            see also :func:`~integ_gym.eval.panel.home.provenance`.
    """
    target = _load(given) if isinstance(given, str) else given
    known, environments = provenance(env_id, None, home, environment)
    policy = _as_policy(target, _name(given, target), env_id, known.environment, environments)
    policy = replace(policy, policy_id=row_name(policy.policy_id))
    bare = _is_sb3_model(target) and lacks_statistics(target)
    return Existing(policy, known, {}, None, environments.single_action_space, bare)


def _load(reference: str) -> Any:
    module, _, name = reference.partition(":")
    try:
        target: Any = importlib.import_module(module)
        for part in name.split("."):
            target = getattr(target, part)
        return target() if isinstance(target, type) else target
    except Exception as error:  # whatever the user's module does while it is imported
        raise InputError(
            f"cannot load policy {reference!r}: {type(error).__name__}: {error}; write it as "
            '"module:function", importable from here'
        ) from error


def _name(given: Any, target: Any) -> str:
    if isinstance(given, str):
        return given.rpartition(":")[2]
    named = getattr(target, "__name__", type(target).__name__)
    return "policy" if named == "<lambda>" else str(named)


def _as_policy(
    target: Any,
    name: str,
    env_id: str,
    arguments: Mapping[str, Any],
    environments: DiscretizedVectorEnv,
) -> Any:
    """A policy, checked against the environment's spaces.

    A model of stable-baselines3 is read as its file would be, so that it acts by the same numbers.
    """
    action_space = environments.single_action_space
    if _is_sb3_model(target):
        try:
            return fitted(read_sb3_model(target, name), environments)
        except PolicyFileError:  # what is not read is asked
            target = RawModel(target)
    if isinstance(target, Policy):
        if isinstance(target, MlpPolicy | ProgramPolicy):
            return fitted(target, environments)
        if is_dataclass(target):
            return target
        return CalledPolicy(target, action_space, target.policy_id, target.content_hash)
    called = CalledPolicy(target, action_space, name)
    observations = _observations(env_id, arguments)
    return replace(called, content_hash=behaviour_hash(called, observations))


def _is_sb3_model(target: Any) -> bool:
    kinds = {base.__module__.partition(".")[0] for base in type(target).__mro__}
    return "stable_baselines3" in kinds and hasattr(target, "policy_kwargs")


def _observations(env_id: str, arguments: Mapping[str, Any]) -> NDArray[Any]:
    """Observations of the environment under random actions, the same every time."""
    own = {name: value for name, value in arguments.items() if name != "solver"}
    environments = make_training_environments(env_id, own, LANES)
    environments.action_space.seed(0)
    observation, _ = environments.reset(seed=list(range(LANES)))  # type: ignore[arg-type]
    seen = [observation.copy()]
    for _ in range(STEPS):
        seen.append(environments.step(environments.action_space.sample())[0].copy())
    environments.close()
    return np.concatenate(seen)


def policy_of(record: EvidenceRecord, store: EvidenceStore, own_code: bool = False) -> Policy:
    """What acted in a record: a policy with its hash, from its run's ``policies`` or made again.

    Raises:
        PolicyFileError: for a policy that cannot be read.
        ValueError: if there is no policy of that hash, with the remedy.
    """
    name, wanted = record["policy_id"], record["policy_hash"]
    if not wanted:
        raise InputError(
            "the policy of a training episode has changed since, so it cannot act again; give a "
            "record of an evaluation, or one that has a trace, without --on"
        )
    policies = store.directory.parent / "policies"
    for path, obs_stats in _files(policies, name):
        if _read_stated_hash(path) in (wanted, None):
            own = _own_arguments(record)
            found: Any = read_existing(path, record["env_id"], own, obs_stats, own_code).policy
            if found.content_hash == wanted:
                named: Policy = replace(found, policy_id=name)
                return named
    if name in BASELINES:
        baseline = _baseline(name, record, store)
        if baseline.content_hash == wanted:
            return baseline
    raise InputError(
        f"the policy {name} of this record is not in {policies} and cannot be made again; restore "
        "its folder, or leave --on out for what has a trace"
    )


@dataclass
class ActingIn:
    """What acted in the records of a run, each policy found once; see :func:`policy_of`.

    Attributes:
        store: of the run.
        own_code: whether classes that side-cars name may be loaded.
    """

    store: EvidenceStore
    own_code: bool = False
    _found: dict[tuple[str, str], Policy] = field(default_factory=dict, repr=False)

    def __call__(self, record: EvidenceRecord) -> Acting:
        """The policy of a record, at the beginning of episodes."""
        key = (record["policy_id"], record["policy_hash"])
        if key not in self._found:
            self._found[key] = policy_of(record, self.store, self.own_code)
        return start_acting(self._found[key])

    def __getstate__(self) -> dict[str, Any]:
        """Without the policies, which another process finds for itself."""
        return {**self.__dict__, "_found": {}}


def _files(policies: Path, name: str) -> Iterator[tuple[Path, Path | None]]:
    """File and observation statistics of every policy of a run, that of a name first."""
    for folder in sorted(policies.glob("*/"), key=lambda own: (own.name != name, own.name)):
        kept = find_policy(folder)
        if kept is not None:
            yield kept


def _read_stated_hash(path: Path) -> str | None:
    """The hash that a side-car tells; None where it must be computed."""
    if any(path.parent.glob("obs_stats.*")):
        return None
    with suppress(ValueError):
        sidecar = read_object(path.with_suffix(".json"), {"content_hash": str}, "")
        return str(sidecar["content_hash"])
    return None


def _baseline(name: str, record: EvidenceRecord, store: EvidenceStore) -> Policy:
    """A baseline for the undisturbed task, as its run made it."""
    env_id, testbed = record["env_id"], find_testbed(record["env_id"], _own_arguments(record))
    if not is_integ_environment(env_id):
        setup = nominal_setup(testbed, testbed.home.control_period)
        return make_baseline(name, setup, controller=testbed.controller)
    found = store.query(
        "SELECT arguments FROM records WHERE phase = 'evaluation' AND perturbation IS NULL "
        "ORDER BY integrator <> 'reference' LIMIT 1"
    ).column("arguments")
    text = found[0].as_py() if len(found) else record["arguments"]
    setup = environment_setup(env_id, argument_values(text))
    return make_baseline(name, setup, controller=testbed.controller)


def _own_arguments(record: EvidenceRecord) -> dict[str, Any]:
    """What a testbed of the user's own was made with."""
    if ":" not in record["env_id"] or is_integ_environment(record["env_id"]):
        return {}
    own = model_arguments(record.arguments())
    return {name: value for name, value in own.items() if name not in VARIED}
