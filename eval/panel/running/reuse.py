"""Policies of a finished panel, taken into another one with their training evidence."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..specification import PanelSpec
from .run_directory import MANIFEST, RunDirectory, RunDirectoryError, read_json
from .units import Unit, is_trained, trained_units, training_config, training_key


class FinishedPolicies:
    """The policies of a panel's directory, each of which another panel would train alike.

    Args:
        path: directory of the panel that trained them.
        spec: the panel that wants them.

    Raises:
        RunDirectoryError: unless the directory has every policy of ``spec`` with its training
            evidence, trained by the same trainer with the same key.
    """

    def __init__(self, path: Path, spec: PanelSpec) -> None:
        self._spec = spec
        manifest = path / MANIFEST
        if not manifest.exists():
            raise RunDirectoryError(
                f"{path} holds no panel; give --policies the directory of a finished one"
            )
        held = read_json(manifest).get("specification", {})
        self._source = RunDirectory(path, held)
        wanted, trainer = spec.to_json()["trainer"], held.get("trainer")
        if trainer != wanted:
            raise RunDirectoryError(
                f"the policies in {path} come from trainer {_named(trainer)}, this panel's from "
                f"{_named(wanted)}; choose with --trainer, or train without --policies"
            )
        for unit in trained_units(self._spec):
            self._check(unit)

    def bring(self, directory: RunDirectory) -> None:
        """Copy every policy that is not there yet; its marker comes last.

        Args:
            directory: held by the caller.
        """
        for unit in trained_units(self._spec):
            if not is_trained(directory, unit, self._key(unit)):
                directory.discard_remains(unit.training)
                target = directory.policies / unit.policy
                shutil.rmtree(target, ignore_errors=True)
                shutil.copytree(self._source.policies / unit.policy, target)
                directory.adopt(self._source, unit.training)

    def _key(self, unit: Unit) -> str:
        return training_key(training_config(self._spec, unit))

    def _check(self, unit: Unit) -> None:
        marker = self._source.marker(unit.training)
        if marker is not None and marker.get("key") != self._key(unit):
            raise RunDirectoryError(
                f"policy {unit.policy} in {self._source.path} was trained with other "
                "hyperparameters, on another environment or by another version; train without "
                "--policies"
            )
        if marker is None or not is_trained(self._source, unit, self._key(unit)):
            raise RunDirectoryError(
                f"{self._source.path} has no finished policy {unit.policy}; give the directory of "
                "a finished panel with all rows and seeds of this one, or train without --policies"
            )


def _named(trainer: Any) -> str:
    if not isinstance(trainer, Mapping):
        return repr(trainer)
    packages = [f"{k} {v}" for k, v in trainer.items() if k != "name"]
    return " with ".join([repr(trainer.get("name")), *packages])
