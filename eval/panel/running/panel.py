"""The panel: training runs and evaluations in a pool of processes, resumable."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from integ_gym.support.executors import Cluster
from integ_gym.support.processes import cores
from integ_gym.support.storage import Storage
from integ_gym.train.fleet.worker import workers_of
from integ_gym.train.policy_files.sidecar import read_trained, readable_file

from ..cells import SpecError
from ..plan import continued
from ..spec import PanelSpec
from .costs.expected_time import check_cost
from .evaluation.subjects import Subject
from .evaluation.units import evaluate_all, evaluated
from .reuse import bring, finished_policies
from .run_directory import MANIFEST, RunDirectory, read_manifest
from .training import check_training, memory_of, train_units
from .units import Unit, baseline_of, is_card_of, units_of
from .work import PanelError


def check_spec(spec: PanelSpec, cluster: Cluster | None = None) -> None:
    """Check what only the trainer and the baselines know.

    Args:
        spec: the panel.
        cluster: where it runs; by default on this machine.

    Raises:
        SpecError: for unknown hyperparameters or baselines, or what the trainer cannot train.
        ModuleNotFoundError: if it needs an extra that is missing.
    """
    for name in ("env_id", "env_arguments", "seed"):
        if name in spec.training:
            raise SpecError(
                f"panel {spec.name!r}: `{name}` in `training` is set by the panel itself; use "
                "`env_id`, `environment` and `seeds`"
            )
    check_cost(spec)
    where = cluster or Cluster(cores())
    try:
        for name in spec.baselines:
            baseline_of(spec, name)
        check_training(spec, workers_of(where), memory_of(spec, where))
    except (TypeError, ValueError) as error:
        raise SpecError(f"panel {spec.name!r}: {error}") from error


def as_there(spec: PanelSpec, storage: Storage) -> PanelSpec:
    """The same panel with its episodes in the parts in which a directory has them; see `parts`.

    Args:
        spec: the panel.
        storage: its directory, or where else it is kept.

    Raises:
        RunDirectoryError: if what the directory says of its run is damaged.
    """
    storage.fetch(MANIFEST)
    manifest = storage.path / MANIFEST
    if not manifest.exists():
        return spec
    return continued(spec, read_manifest(manifest)["specification"])


@contextmanager
def opened(
    spec: PanelSpec, out: Storage, cluster: Cluster | None = None, policies: Path | None = None
) -> Iterator[RunDirectory]:
    """The directory of a panel that can be run, held; see `complete`.

    Args:
        spec: the panel.
        out: its directory, or where else it is kept.
        cluster: where it runs; by default on this machine.
        policies: directory of a finished panel whose policies are taken instead of training.

    Raises:
        SpecError, RunDirectoryError: for what cannot be run, before anything is written.
    """
    check_spec(spec, cluster)
    directory = RunDirectory(out, spec.to_json(), spec.engine_versions())
    source = None if policies is None else finished_policies(policies, spec)
    with directory.opened():
        if source is not None:
            bring(source, directory, spec)
        yield directory


def complete(
    spec: PanelSpec,
    directory: RunDirectory,
    label: str,
    cluster: Cluster,
    progress: bool = True,
) -> bool:
    """Train and evaluate everything that is not finished yet; whether there was anything.

    Args:
        spec: the panel, or a stage of it.
        directory: held by the caller.
        label: of the bar.
        cluster: where.
        progress: show a bar with the remaining time.

    Raises:
        PanelError: if a unit of work fails; what was finished stays.
    """
    before = evaluated(directory)
    train_units(spec, directory, cluster, progress)
    subjects = [subject_of(spec, directory, unit) for unit in units_of(spec)]
    evaluate_all(spec, directory, subjects, label, cluster, progress)
    return evaluated(directory) != before


def subject_of(spec: PanelSpec, directory: RunDirectory, unit: Unit) -> Subject:
    """The policy of a unit, read from its file or built."""
    cells = spec.cells_of(unit.home)
    if unit.home is None:
        return Subject(baseline_of(spec, unit.row), cells, starts=spec.start_sets[0])
    policy, card = read_trained(readable_file(directory.policies / unit.policy))
    marker = directory.marker(unit.training)
    if marker is None or not is_card_of(card, marker):
        raise PanelError(
            f"policies/{unit.policy} is not the policy that this panel trained, or its side-car is "
            "not what it was; restore it, or give another directory with --out"
        )
    own = replace(policy, policy_id=unit.policy)
    return Subject(own, cells, unit.home, unit.seed, unit.seed or 0)
