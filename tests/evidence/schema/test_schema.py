"""One definition of the record: Arrow schema, JSON Schema and records agree with it."""

from __future__ import annotations

import json
from dataclasses import fields as dataclass_fields

import gymnasium as gym
import jsonschema
import pytest

from integ_gym.envs.plants.interface import state_names
from integ_gym.envs.registries import ENVIRONMENTS, PLANTS, TASKS
from integ_gym.envs.settings import Settings
from integ_gym.evidence.fields import (
    CELL_STATUSES,
    SCHEMA_VERSION,
    SUMMARY_FIELDS,
    record_fields,
)
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.schema import (
    ENV_KEY,
    SCHEMA_PATH,
    VERSION_KEY,
    arrow_schema,
    described,
    json_schema,
    schema_text,
)
from integ_gym.evidence.store import EvidenceStore


def _tasks():
    return [TASKS.load(name) for name in TASKS.names()]


def test_published_json_schema_is_what_the_definition_gives():
    assert SCHEMA_PATH.read_text(encoding="utf-8") == schema_text()
    jsonschema.Draft202012Validator.check_schema(json_schema())


@pytest.mark.parametrize("task", _tasks(), ids=lambda task: task.__name__)
def test_every_column_states_unit_and_frame(task):
    plant = PLANTS.load(task.plant)
    fields = record_fields(plant, task)
    schema = arrow_schema(fields, "Any-v0")
    assert schema.metadata == {VERSION_KEY: str(SCHEMA_VERSION).encode(), ENV_KEY: b"Any-v0"}
    framed = {*state_names(plant), *(f"sensed_{name}" for name in task.observation_names)}
    framed |= {f"{plant.control_name}_{end}" for end in ("commanded", "applied")}
    framed |= {"initial_state", "penetration", "contact_force"}
    for field in schema:
        about = described(field)
        numeric = str(field.type) not in ("string", "bool", "timestamp[us, tz=UTC]")
        assert bool(about["unit"]) == numeric, field.name
        assert about["meaning"], field.name
        assert bool(about["frame"]) or field.name not in framed, field.name
        assert bool(about["at"]) == (about["group"] == "trace"), field.name


def test_units_of_common_arguments_are_the_settings_own():
    units = {field.name: field.unit for field in SUMMARY_FIELDS}
    for field in dataclass_fields(Settings):
        if field.name != "max_speed" and field.name in units:
            assert units[field.name] == field.metadata["unit"], field.name


def test_column_named_twice_is_refused():
    plant = PLANTS.load("pendulum")
    clashing = type("Clashing", (plant,), {"name": "clashing", "coordinates": ("length",)})
    with pytest.raises(ValueError, match=r"two columns named length.*rename"):
        record_fields(clashing, TASKS.load("pendulum_swing_up"))


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_records_of_every_environment_follow_both_schemas(env_id, tmp_path, context, play):
    env = RecordEvidence(gym.make(env_id, duration=1.0), tmp_path, context)
    task = env.unwrapped.setup.task
    play(env, range(2))
    env.close()
    store = EvidenceStore(tmp_path)
    validator = jsonschema.Draft202012Validator(
        json_schema(), format_checker=jsonschema.FormatChecker()
    )
    records = list(store.records())
    assert len(records) == 2
    for record in records:
        document = json.loads(record.to_json())
        validator.validate(document)
        names = {field.name for field in record_fields(env.unwrapped.setup.plant, task)}
        assert set(document) == names
        validator.validate(record.summary())
        with pytest.raises(jsonschema.ValidationError):
            validator.validate({**document, "success": "yes"})
        for status in CELL_STATUSES:
            validator.validate({**document, "cell_status": status})
        with pytest.raises(jsonschema.ValidationError):
            validator.validate({**document, "cell_status": "impossible"})
        with pytest.raises(jsonschema.ValidationError):
            validator.validate({**document, "surprise": "text"})
