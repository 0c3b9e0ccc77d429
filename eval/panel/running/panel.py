"""The panel: training runs and evaluations in a pool of processes, resumable."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from integ_gym.support.processes.workers import cores
from integ_gym.support.sharing.claims import LEASE
from integ_gym.support.storing.places import as_storage
from integ_gym.support.storing.storage import Storage
from integ_gym.train.fleet.worker import Workers, fleet_workers
from integ_gym.train.policy_files.sidecar import read_trained, readable_file

from ..specification.difference import continued
from ..specification.panel_spec import PanelSpec
from ..specification.values import SpecError
from .costs.expected_time import check_cost
from .evaluation.subjects import Subject
from .evaluation.units import evaluate_all, evaluated
from .reuse import bring, finished_policies
from .run_directory import MANIFEST, RunDirectory, read_manifest
from .training import check_training, train_units
from .units import Unit, baseline_of, is_card_of, units_of
from .work import PanelError


def check_spec(
    spec: PanelSpec, workers: int | Workers | None = None, memory_gib: float | None = None
) -> None:
    """Check what only the trainer and the baselines know.

    Args:
        spec: the panel.
        workers: processes, if so many are requested, or the fleet's.
        memory_gib: that they may take together; by default the specification's.

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
    try:
        for name in spec.baselines:
            baseline_of(spec, name)
        fleet = workers if isinstance(workers, Workers) else fleet_workers(workers)
        check_training(spec, fleet, memory_gib or spec.memory_gib)
    except (TypeError, ValueError) as error:
        raise SpecError(f"panel {spec.name!r}: {error}") from error


def as_there(spec: PanelSpec, out: Path | Storage) -> PanelSpec:
    """The same panel with its episodes in the parts in which a directory has them; see `parts`.

    Args:
        spec: the panel.
        out: its directory, or where else it is kept.

    Raises:
        RunDirectoryError: if what the directory says of its run is damaged.
    """
    storage = as_storage(out)
    storage.fetch(MANIFEST)
    manifest = storage.path / MANIFEST
    if not manifest.exists():
        return spec
    return continued(spec, read_manifest(manifest)["specification"])


@contextmanager
def opened(
    spec: PanelSpec,
    out: Path | Storage,
    *,
    workers: int | Workers | None = None,
    memory_gib: float | None = None,
    policies: Path | None = None,
    lease: float = LEASE,
) -> Iterator[RunDirectory]:
    """The directory of a panel that can be run, held; see `complete`.

    Args:
        spec: the panel.
        out: its directory, or where else it is kept.
        workers: processes, if so many are requested, or the fleet's.
        memory_gib: that they may take together; by default the specification's.
        policies: directory of a finished panel whose policies are taken instead of training.
        lease: see :meth:`RunDirectory.opened`.

    Raises:
        SpecError, RunDirectoryError: for what cannot be run, before anything is written.
    """
    check_spec(spec, workers, memory_gib)
    directory = RunDirectory(out, spec.to_json(), spec.engine_versions())
    source = None if policies is None else finished_policies(policies, spec)
    with directory.opened(lease):
        if source is not None:
            bring(source, directory, spec)
        yield directory


def complete(
    spec: PanelSpec,
    directory: RunDirectory,
    label: str,
    *,
    workers: int | None = None,
    progress: bool = True,
) -> bool:
    """Train and evaluate everything that is not finished yet; whether there was anything.

    Args:
        spec: the panel, or a stage of it.
        directory: held by the caller.
        label: of the bar.
        workers: processes; by default one per core.
        progress: show a bar with the remaining time.

    Raises:
        PanelError: if a unit of work fails; what was finished stays.
    """
    before = evaluated(directory)
    train_units(spec, directory, workers, progress)
    subjects = [subject_of(spec, directory, unit) for unit in units_of(spec)]
    evaluate_all(spec, directory, subjects, label, workers or cores(), progress)
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
