"""One definition of the record, and a hash that tells every change of one but volatile fields."""

from __future__ import annotations

import hashlib
import json
from dataclasses import fields as dataclass_fields
from itertools import pairwise

import jsonschema
import numpy as np
import pyarrow as pa
import pytest
from forgery import with_column
from hypothesis import given
from hypothesis import strategies as st
from recording import CONTEXT, recorded

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.plants.interface import state_names
from integ_gym.envs.registries import ENVIRONMENTS, PLANTS, TASKS
from integ_gym.envs.settings import Settings
from integ_gym.evidence.episodes import Layout, summarise
from integ_gym.evidence.fields import (
    COMMON_TRACE,
    SCHEMA_VERSION,
    SUMMARY_FIELDS,
    VOLATILE_NAMES,
    record_fields,
)
from integ_gym.evidence.hashing import content_hashes
from integ_gym.evidence.schema import (
    ENV_KEY,
    SCHEMA_PATH,
    VERSION_KEY,
    arrow_schema,
    described,
    is_trace,
    json_schema,
    schema_text,
)

VALIDATOR = jsonschema.Draft202012Validator(
    json_schema(), format_checker=jsonschema.FormatChecker()
)


def test_published_json_schema_is_what_the_definition_gives():
    assert SCHEMA_PATH.read_text(encoding="utf-8") == schema_text()
    jsonschema.Draft202012Validator.check_schema(json_schema())


@pytest.mark.parametrize("name", TASKS.names())
def test_every_column_states_unit_and_frame(name):
    task = TASKS.load(name)
    plant = PLANTS.load(task.plant)
    schema = arrow_schema(record_fields(plant, task), "Any-v0")
    assert schema.metadata == {VERSION_KEY: str(SCHEMA_VERSION).encode(), ENV_KEY: b"Any-v0"}
    framed = {*state_names(plant), *(f"sensed_{name}" for name in task.observation_names)}
    framed |= {f"{plant.controls[0][0]}_{end}" for end in ("commanded", "applied")}
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
def test_records_of_every_environment_follow_both_schemas(env_id, tmp_path):
    setup = environment_setup(env_id, {})
    (record,) = recorded(tmp_path, [0], CONTEXT, env_id).records()
    document = json.loads(record.to_json())
    VALIDATOR.validate(document)
    VALIDATOR.validate(record.summary())
    VALIDATOR.validate({**document, "cell_status": "unachievable"})
    assert set(document) == {field.name for field in record_fields(setup.plant, setup.task)}
    for wrong in ({"success": "yes"}, {"cell_status": "impossible"}, {"surprise": "text"}):
        with pytest.raises(jsonschema.ValidationError):
            VALIDATOR.validate({**document, **wrong})


def _altered(value):
    """Another value of the same type."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return value + " "
    if isinstance(value, float):
        return float(np.nextafter(value, np.inf))
    if isinstance(value, int):
        return value + 1
    if isinstance(value, list):
        first = value[0]
        step = float(np.nextafter(np.float32(first), np.inf))
        return [step if isinstance(first, float) else first + 1, *value[1:]]
    return value.replace(year=1999)


def test_hash_is_stored_and_stable(table):
    stored = table.column("content_hash").to_pylist()
    assert len(set(stored)) == 3
    assert content_hashes(table) == stored
    assert content_hashes(table.select(sorted(table.column_names, reverse=True))) == stored
    assert content_hashes(pa.concat_tables([table, table.slice(0, 2)])) == stored + stored[:2]


def test_hash_is_the_documented_one(table):
    """The same hash from its description, without the code that made it."""
    record = table.slice(2, 1)
    names = sorted(name for name in record.column_names if name not in VOLATILE_NAMES)
    kinds = {}
    for name in names:
        field = record.schema.field(name)
        kind = field.type
        kind = f"list<{kind.value_type}>" if isinstance(kind, pa.ListType) else str(kind)
        kinds[name] = [kind, described(field)["unit"], described(field)["frame"]]
    row = record.to_pylist()[0]
    values = {name: row[name] for name in names if is_trace(name)}
    present = {k: v and [x for x in v if x is not None] for k, v in values.items()}
    counts = {name: None if v is None else len(v) for name, v in present.items()}
    fields = {name: row[name] for name in names if not is_trace(name)}

    def text(value):
        return json.dumps(value, separators=(",", ":"), ensure_ascii=False).encode()

    types = {"double": "<f8", "float": "<f4", "int32": "<i4", "int8": "<i1"}
    data = b"".join(
        np.array(v, types[kinds[name][0][5:-1]]).tobytes() for name, v in present.items() if v
    )
    expected = hashlib.sha256(text(kinds) + text([fields, counts]) + data).hexdigest()
    assert row["content_hash"] == expected


ODD = {
    "no nulls at the ends": [[None, 1.0, None, 2.0], [3.0, None], [None]],
    "more nulls than rows": [[1.0, None, None], None, [None, None]],
    "empty and missing": [[], None, [0.5]],
    "zeros and none": [[-0.0], [0.0], [float("nan"), None]],
}
"""Values of a trace column that recorders do not write, and other programs may."""


@pytest.mark.parametrize("values", ODD.values(), ids=ODD)
def test_rows_hash_together_as_they_do_alone(table, values):
    changed = with_column(table, "theta", values)
    changed = with_column(changed, "energy_residual_total", [0.0, -0.0, None])
    without = [name for name in table.column_names if not is_trace(name)]
    for made in (changed, changed.select(without)):
        hashes = content_hashes(made)
        assert len(set(hashes)) == 3
        for row, together in enumerate(hashes):
            alone = made.slice(row, 1)
            (expected,) = content_hashes(pa.Table.from_pylist(alone.to_pylist(), made.schema))
            assert together == expected


def test_every_field_counts_unless_volatile(table):
    before = content_hashes(table)
    filled = {"float64": 1.5, "int64": 1, "string": "x", "json": "{}", "bool": False}
    for field in SUMMARY_FIELDS:
        values = table.column(field.name).to_pylist()
        changed = [filled[field.kind] if x is None else _altered(x) for x in values]
        same = [x in before for x in content_hashes(with_column(table, field.name, changed))]
        assert same == [field.name in VOLATILE_NAMES] * 3, field.name


def test_every_trace_value_counts(table):
    before = set(content_hashes(table))
    for name in ("theta", "sensed_cos_theta", *(field.name for field in COMMON_TRACE)):
        values = table.column(name).to_pylist()
        for changed in (map(_altered, values), (x[:-2] for x in values), [None] * 3, [[]] * 3):
            assert not set(content_hashes(with_column(table, name, list(changed)))) & before, name
    totals = ([0.0, 0.0, 0.0], [0.0, -0.0, 0.0])
    same, other = (content_hashes(with_column(table, "energy_residual_total", x)) for x in totals)
    assert [a == b for a, b in zip(same, other, strict=True)] == [True, False, True]


def test_unit_frame_type_and_columns_count(table):
    before = set(content_hashes(table))
    index = table.schema.get_field_index("theta")
    field = table.schema.field(index)
    for metadata in ({b"unit": b"deg"}, {b"frame": b"elsewhere"}):
        changed = table.set_column(
            index, field.with_metadata({**field.metadata, **metadata}), table.column(index)
        )
        assert not set(content_hashes(changed)) & before
    assert not set(content_hashes(table.drop_columns(["theta"]))) & before
    narrow = table.column(index).cast(pa.list_(pa.float32()))
    assert not set(content_hashes(table.set_column(index, "theta", narrow))) & before


TASK = TASKS.load("pendulum_swing_up")
LAYOUT = Layout(PLANTS.load(TASK.plant), TASK, {"penetration": 0.0})

whole = st.integers(0, 3).map(float)
flags = st.booleans().map(float)
steps = st.lists(
    st.fixed_dictionaries(
        {
            "reward": whole,
            "energy_residual": st.integers(-3, 3).map(float),
            "fallback_used": flags,
            "saturated": flags,
            "solver_iterations": whole,
            "solver_status": st.integers(0, 2).map(float),
            "penetration": whole,
            "at_goal": st.booleans(),
        }
    ),
    min_size=1,
    max_size=6,
)
episodes = st.lists(st.tuples(st.booleans(), steps, st.booleans()), min_size=1, max_size=4)


def _rows(drawn):
    """The rows of the drawn episodes, shape (entries, rows), and how many each has."""
    rows = []
    for at_goal, each, success in drawn:
        since = 0.0 if at_goal else -1.0
        rows.append({"time": 0.0, "energy": 1.0, "goal_since": since})
        for k, step in enumerate(each, start=1):
            since = (since if since >= 0.0 else float(k)) if step["at_goal"] else -1.0
            row = {"time": float(k), "energy": 1.0 + k, "goal_since": since, "theta": 0.5}
            rows.append(row | {n: x for n, x in step.items() if n != "at_goal"})
        rows[-1]["success"] = float(success)
        rows[-1]["truncated"] = 1.0
    columns = np.array([[row.get(name, 0.0) for row in rows] for name in LAYOUT.names])
    return columns, np.array([len(each) + 1 for _, each, _ in drawn])


@given(episodes)
def test_summaries_agree_with_a_loop(drawn):
    rows, counts = _rows(drawn)
    found = summarise(LAYOUT, rows, counts)
    for i, (starts_at_goal, each, success) in enumerate(drawn):
        there = [starts_at_goal, *(step["at_goal"] for step in each)]
        fallback = [0.0, *(step["fallback_used"] for step in each)]
        reached = [k for k, x in enumerate(there) if x]
        left = [k for k in range(1, len(there)) if there[k - 1] and not there[k]]
        expected = {
            "length": len(each),
            "time": len(each),
            "return": sum(step["reward"] for step in each),
            "energy_start": 1.0,
            "energy_end": 1.0 + len(each),
            "energy_residual_total": sum(step["energy_residual"] for step in each),
            "energy_residual_abs_total": sum(abs(step["energy_residual"]) for step in each),
            "saturated_share": sum(step["saturated"] for step in each) / len(each),
            "fallback_count": sum(fallback),
            "recovery_count": sum(a > b for a, b in pairwise(fallback)),
            "solver_iterations_max": max(step["solver_iterations"] for step in each),
            "solver_iterations_mean": sum(s["solver_iterations"] for s in each) / len(each),
            "solver_status": max(step["solver_status"] for step in each),
            "penetration_max": max(step["penetration"] for step in each),
            "success": success,
            "truncated": True,
            "terminated": False,
            "goal_reached": min(reached, default=np.nan),
            "arrival_time": min(reached, default=np.nan),
            "arrival_energy": float(min(reached, default=np.nan)),
            "arrival_residual": sum(step["energy_residual"] for step in each[: reached[0]])
            if reached
            else np.nan,
            "goal_left": max(left, default=np.nan),
        }
        for name, value in expected.items():
            np.testing.assert_equal(float(found[name][i]), float(value), err_msg=name)
        assert np.isnan(found["constraint_violation_max"][i])
        if not success:
            assert np.isnan(found["time_to_success"][i])
        elif there[-1]:
            stay = len(there) - 1
            while stay > 0 and there[stay - 1]:
                stay -= 1
            assert found["time_to_success"][i] == stay
