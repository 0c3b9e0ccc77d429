"""Policies of a finished panel, taken into another one with their training evidence."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..spec import PanelSpec
from .run_directory import MANIFEST, RunDirectory, RunDirectoryError, read_manifest
from .units import Unit, is_there, is_trained, trained_units, training_config, training_key


def finished_policies(path: Path, spec: PanelSpec) -> RunDirectory:
    """The directory of a panel whose policies another one would train alike.

    Args:
        path: directory of the panel that trained them.
        spec: the panel that wants them.

    Raises:
        RunDirectoryError: unless the directory has every policy of ``spec`` with its training
            evidence, trained by the same trainer with the same key.
    """
    manifest = path / MANIFEST
    if not manifest.exists():
        raise RunDirectoryError(
            f"{path} holds no panel; give --policies the directory of a finished one"
        )
    held = read_manifest(manifest)["specification"]
    wanted, trainer = spec.to_json()["trainer"], held.get("trainer")
    if trainer != wanted:
        raise RunDirectoryError(
            f"the policies in {path} come from trainer {_named(trainer)}, this panel's from "
            f"{_named(wanted)}; choose with --trainer, or train without --policies"
        )
    source = RunDirectory(path, held)
    for unit in trained_units(spec):
        _check(source, unit, training_key(training_config(spec, unit)))
    return source


def bring(source: RunDirectory, directory: RunDirectory, spec: PanelSpec) -> None:
    """Copy every policy that is not there yet, and the looks at it; its marker comes last.

    Args:
        source: what :func:`finished_policies` found.
        directory: held by the caller.
        spec: the panel that wants them.
    """
    missing = [unit for unit in trained_units(spec) if not is_there(spec, directory, unit)]
    if missing:
        directory.inherit_looks(source)
        for unit in missing:
            directory.discard_remains(unit.training)
            directory.adopt_policy(source, unit.policy)
            directory.adopt(source, unit.training)
    directory.storage.send()


def _check(source: RunDirectory, unit: Unit, key: str) -> None:
    marker = source.marker(unit.training)
    if marker is not None and marker.get("key") != key:
        raise RunDirectoryError(
            f"policy {unit.policy} in {source.path} was trained with other hyperparameters, on "
            "another environment or by another version; train without --policies"
        )
    if marker is None or not is_trained(source, unit, key):
        raise RunDirectoryError(
            f"{source.path} has no finished policy {unit.policy}; give the directory of a "
            "finished panel with all rows and seeds of this one, or train without --policies"
        )


def _named(trainer: Any) -> str:
    if not isinstance(trainer, Mapping):
        return repr(trainer)
    packages = [f"{k} {v}" for k, v in trainer.items() if k != "name"]
    return " with ".join([repr(trainer.get("name")), *packages])
