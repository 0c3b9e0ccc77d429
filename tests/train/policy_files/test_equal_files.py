"""Weights as safetensors: equal policies are equal files, and which types are read."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from integ_gym.train.policy import BoxActions, MlpPolicy
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.safetensors_file import read_safetensors, safetensors_bytes


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


@pytest.mark.parametrize(
    ("dtype", "size"), [("F8_E4M3", 1), ("F8_E5M2", 1), ("BF16", 2), ("I32", 4), ("BOOL", 1)]
)
def test_types_that_are_no_weights_are_refused_in_a_sentence(
    tmp_path: Path, dtype: str, size: int
) -> None:
    """A header may name types that NumPy lacks, and types that are no weights."""
    content = safetensors_bytes(_policy())
    header = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
    end = 0
    for name in sorted(header.keys() - {"__metadata__"}):
        count = int(np.prod(header[name]["shape"])) * size
        header[name] |= {"dtype": dtype, "data_offsets": [end, end + count]}
        end += count
    text = json.dumps(header).encode()
    path = tmp_path / "policy.safetensors"
    path.write_bytes(len(text).to_bytes(8, "little") + text + bytes(end))
    with pytest.raises(PolicyFileError, match=f"has dtype {dtype}, and a policy is read from F16"):
        read_safetensors(path)
