"""What is said of a policy is what was written of it."""

from __future__ import annotations

import json

import numpy as np
import onnx
import pytest

from integ_gym.train.policy import BoxActions, MlpPolicy
from integ_gym.train.policy_files.card import PolicyFileError, hashed
from integ_gym.train.policy_files.onnx import onnx_card
from integ_gym.train.policy_files.sidecar import read_trained
from integ_gym.train.policy_files.writing import save_policy, write_sidecar

HOME = "integrator=explicit_euler,dt=0.05,control_period=0.1"


@pytest.fixture
def policy(tmp_path):
    random = np.random.default_rng(0)
    layers = ((random.normal(size=(1, 3)), random.normal(size=1)),)
    own = MlpPolicy(layers, "Tanh", BoxActions(np.array([-2.0]), np.array([2.0])))
    path = tmp_path / "mine.safetensors"
    return save_policy(own, path, "IntegPendulum-v0", home=HOME, environment={"max_torque": 1.5})


def _edit(path, change):
    file = path.with_suffix(".json")
    card = json.loads(file.read_text())
    change(card)
    file.write_text(json.dumps(card))


EDITS = {
    "home": lambda card: card["home"].update(integrator="rk4"),
    "environment argument": lambda card: card["config"]["env_arguments"].update(max_torque=9.0),
    "environment": lambda card: card["config"].update(env_id="IntegCartPole-v0"),
    "bounds": lambda card: card.update(action_bounds=[[-1.0], [1.0]]),
    "statistics": lambda card: card["network"].update(
        observation_statistics={"mean": [0.0] * 3, "var": [1.0] * 3}
    ),
    "name": lambda card: card.update(policy_id="better"),
    "seed": lambda card: card.update(seed=1),
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


def test_another_layout_of_the_same_side_car_is_read(policy):
    _edit(policy, lambda card: card.update(sorted(card.items(), reverse=True)))
    assert read_trained(policy)[1]["home"]["integrator"] == "explicit_euler"


def test_a_hash_does_not_hide_another_policy(policy):
    _edit(policy, lambda card: card.update(hashed({**card, "content_hash": "0" * 64})))
    with pytest.raises(PolicyFileError, match="is not the policy that"):
        read_trained(policy)


def test_the_policy_is_known_by_what_decides_its_actions(policy):
    before = read_trained(policy)[0].content_hash
    write_sidecar(policy, "IntegPendulum-v0", home=None)
    assert read_trained(policy)[0].content_hash == before


def test_no_edit_of_metadata_is_read(policy, tmp_path):
    path = save_policy(policy, tmp_path / "mine.onnx", "IntegPendulum-v0", home=HOME)
    assert onnx_card(path)["home"]["integrator"] == "explicit_euler"
    model = onnx.load(path)
    (told,) = model.metadata_props
    told.value = told.value.replace("explicit_euler", "rk4")
    onnx.save(model, path)
    with pytest.raises(PolicyFileError, match="was edited after it was written"):
        onnx_card(path)
