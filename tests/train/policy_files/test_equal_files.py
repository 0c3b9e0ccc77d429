"""Equal policies are equal files, byte by byte."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from integ_gym.train.policy.actions import BoxActions
from integ_gym.train.policy.mlp_policy import MlpPolicy
from integ_gym.train.policy_files.formats.safetensors_file import (
    read_safetensors,
    safetensors_bytes,
)


def _policy() -> MlpPolicy:
    rng = np.random.default_rng(0)
    shapes = ((8, 3), (1, 8))
    layers = tuple((rng.standard_normal(shape), np.zeros(shape[0])) for shape in shapes)
    return MlpPolicy(layers, "Tanh", BoxActions(np.full(1, -2.0), np.full(1, 2.0)))


def test_equal_policies_are_equal_files_that_can_be_read(tmp_path: Path) -> None:
    """The library writes the header's metadata in an order that changes from call to call."""
    contents = {safetensors_bytes(_policy()) for _ in range(20)}
    assert len(contents) == 1
    path = tmp_path / "policy.safetensors"
    path.write_bytes(contents.pop())
    assert read_safetensors(path).content_hash == _policy().content_hash
