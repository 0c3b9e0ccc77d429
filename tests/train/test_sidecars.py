"""What is said of a policy is what was written of it; equal policies are equal files."""

import json

import numpy as np
import onnx
import pytest
from gymnasium import spaces

from integ_gym.train.fleet.learning import initial_stack, state_dict
from integ_gym.train.policy import BoxActions, MlpPolicy
from integ_gym.train.policy_files.card import PolicyFileError, hashed
from integ_gym.train.policy_files.onnx import onnx_card
from integ_gym.train.policy_files.safetensors_file import read_safetensors, safetensors_bytes
from integ_gym.train.policy_files.sidecar import (
    actor_of,
    policy_file,
    read_trained,
    readable_file,
    write_actor,
)
from integ_gym.train.policy_files.writing import save_policy, write_sidecar

HOME = "integrator=explicit_euler,dt=0.05,control_period=0.1"


def _policy():
    random = np.random.default_rng(0)
    layers = ((random.normal(size=(1, 3)), random.normal(size=1)),)
    return MlpPolicy(layers, "Tanh", BoxActions(np.array([-2.0]), np.array([2.0])))


@pytest.fixture
def policy(tmp_path):
    told = {"home": HOME, "environment": {"max_torque": 1.5}}
    return save_policy(_policy(), tmp_path / "mine.safetensors", "IntegPendulum-v0", **told)


def _edit(path, change):
    file = path.with_suffix(".json")
    card = json.loads(file.read_text())
    change(card)
    file.write_text(json.dumps(card))


EDITS = {
    "home": lambda card: card["home"].update(integrator="rk4"),
    "further entry": lambda card: card.update(note="mine"),
    "no hash": lambda card: card.pop("card_hash"),
    "another hash": lambda card: card.update(card_hash="0" * 64),
}


@pytest.mark.parametrize("change", EDITS.values(), ids=EDITS)
def test_no_edit_of_a_side_car_is_read(policy, change):
    read_trained(policy)
    _edit(policy, change)
    with pytest.raises(PolicyFileError, match=r"mine\.json: was edited after it was written"):
        read_trained(policy)
    write_sidecar(policy, "IntegPendulum-v0", home=HOME)
    read_trained(policy)


def test_a_side_car_is_read_in_any_layout_and_hides_no_other_policy(policy):
    before = read_trained(policy)[0].content_hash
    _edit(policy, lambda card: card.update(sorted(card.items(), reverse=True)))
    assert read_trained(policy)[1]["home"]["integrator"] == "explicit_euler"
    _edit(policy, lambda card: card.update(hashed({**card, "content_hash": "0" * 64})))
    with pytest.raises(PolicyFileError, match="is not the policy that"):
        read_trained(policy)
    write_sidecar(policy, "IntegPendulum-v0", home=None)
    assert read_trained(policy)[0].content_hash == before, "it is known by what decides its actions"


def test_no_edit_of_metadata_is_read(policy, tmp_path):
    path = save_policy(policy, tmp_path / "mine.onnx", "IntegPendulum-v0", home=HOME)
    assert onnx_card(path)["home"]["integrator"] == "explicit_euler"
    model = onnx.load(path)
    (told,) = model.metadata_props
    told.value = told.value.replace("explicit_euler", "rk4")
    onnx.save(model, path)
    with pytest.raises(PolicyFileError, match="was edited after it was written"):
        onnx_card(path)


TORQUE = spaces.Box(-2.0, 2.0, (1,), np.float32)
CARD = {"policy_id": "mine", "seed": 0}


def _actor(seed=0, space=TORQUE):
    outputs = 1 if isinstance(space, spaces.Box) else int(space.n)
    noise = [0.0] if isinstance(space, spaces.Box) else None
    weights = state_dict(initial_stack([seed], (3, 8, 4), outputs, noise), 0)
    return actor_of(weights, 2, "Tanh", space)


@pytest.mark.parametrize("space", [TORQUE, spaces.Discrete(2)])
def test_the_side_car_names_the_weights(tmp_path, space):
    actor = _actor(space=space)
    (tmp_path / "policy.zip").write_bytes(b"of a policy that is replaced")
    written = write_actor(tmp_path, actor, CARD, space)
    assert {path.name for path in tmp_path.iterdir()} == {"policy.json", "policy.safetensors"}
    assert written.card["policy_file"] == "policy.safetensors"
    assert written.policy == policy_file(tmp_path) == readable_file(tmp_path)
    read, card = read_trained(written.policy)
    assert read.content_hash == actor.content_hash == card["content_hash"]
    assert read.policy_id == "mine"


def test_weights_that_are_not_finite_are_no_policy():
    weights = state_dict(initial_stack([0], (3, 8, 4), 1, [0.0]), 0)
    weights["action_net.bias"][:] = np.nan
    with pytest.raises(PolicyFileError, match="training left a policy that cannot be used: "):
        actor_of(weights, 2, "Tanh", TORQUE)


def test_the_weights_are_read_where_the_zip_is_the_one_written_with_them(tmp_path):
    write_actor(tmp_path, _actor(), CARD, TORQUE, b"a zip")
    named, weights = tmp_path / "policy.zip", tmp_path / "policy.safetensors"
    assert policy_file(tmp_path) == named
    assert readable_file(tmp_path) == weights
    named.write_bytes(b"another zip")
    assert readable_file(tmp_path) == named
    named.write_bytes(b"a zip")
    weights.unlink()
    assert readable_file(tmp_path) == named


def test_a_side_car_names_no_file_elsewhere(tmp_path):
    card = hashed({"format": "integ-gym policy 2", "policy_file": "../policy.zip"})
    (tmp_path / "policy.json").write_text(json.dumps(card))
    assert policy_file(tmp_path) == tmp_path / "policy.zip"


def test_equal_policies_are_equal_files_that_can_be_read(tmp_path):
    """The library writes the header's metadata in an order that changes from call to call."""
    contents = {safetensors_bytes(_policy()) for _ in range(20)}
    path = tmp_path / "policy.safetensors"
    (content,) = contents
    path.write_bytes(content)
    assert read_safetensors(path).content_hash == _policy().content_hash


@pytest.mark.parametrize(
    ("dtype", "size"), [("F8_E4M3", 1), ("F8_E5M2", 1), ("BF16", 2), ("I32", 4), ("BOOL", 1)]
)
def test_types_that_are_no_weights_are_refused_in_a_sentence(tmp_path, dtype, size):
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
