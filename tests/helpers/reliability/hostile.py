"""Files and arguments of a stranger: read as they are, or refused in one sentence."""

from __future__ import annotations

import io
import json
import math
import random
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import pyarrow as pa
import pyarrow.parquet as pq
from damage import flip, lengthen, overwrite, truncate
from forgery import EVALUATED, make_fit
from victim import Victim, command, write_spec

import integ_gym  # noqa: F401
from integ_gym.eval.panel.run_directory import RunDirectory, read_manifest
from integ_gym.eval.panel.spec import read_spec
from integ_gym.evidence.exporting import EXPORT_FORMATS
from integ_gym.evidence.hashing import with_hashes
from integ_gym.evidence.schema import is_trace
from integ_gym.support.parameters import finite_number
from integ_gym.train.policy_files.sidecar import read_sidecar, read_trained

NUMBERS = (
    "0", "-1", "1e9", "1e400", "-1e-400", "nan", "inf", "1" * 5000, "1" + "0" * 400, "true", '"x"',
    "[]", "{}", "[1e9]", "null", "0x7fffffffffffffff", "9223372036854775808", "1.5",
)  # fmt: skip
TEXTS = (
    "", "null", "[]", "{}", "1", '"x"', "{", "[" * 5000, "1" * 5000, "IntegCartPole-v0",
    "module:Class", "rk4", "none", "\x1b[2J", "x/y/z", "-1/0", "1/0", "CartPole-v1",
)  # fmt: skip
NESTED = ("[" * 100_000, "[" * 100_000 + "]" * 100_000, '{"a":' * 5000, "[[[[]]]]")

ARGUMENTS = (
    "integrator", "dt", "control_period", "duration", "max_speed", "action_latency",
    "sensor_period", "observation_noise", "mass", "length", "gravity", "start", "engine", "mixture",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    0, -1, 1e-9, 1e-320, 1e9, 1e300, float("nan"), float("inf"), 10**400, 10**5000, True, None,
    "x", "rk4", "", [], {}, [1e9], (1, 2), b"x", 0.05, 1,
)  # fmt: skip


def archive(victim: Victim, folder: Path, rng: random.Random) -> None:
    """A policy's zip, or a member of it, changed anywhere: never another policy."""
    source = victim.run / "policies" / "rk4-dt-0.05-seed0"
    file = folder / "policy.zip"
    (folder / "policy.json").write_bytes((source / "policy.json").read_bytes())
    file.write_bytes((source / "policy.zip").read_bytes())
    if rng.random() < 0.5:
        rng.choice((flip, overwrite, lengthen, truncate))(file, file, rng)
    else:
        file.write_bytes(_member_changed(file, rng))
    expected = json.loads((source / "policy.json").read_text())["content_hash"]
    read = refused_or(lambda: read_trained(file))
    assert read is None or read[0].content_hash == expected


def sidecar(victim: Victim, folder: Path, rng: random.Random) -> None:
    """A policy's side-car with anything in it."""
    source = victim.run / "policies" / "rk4-dt-0.05-seed0" / "policy.json"
    file = folder / "policy.json"
    _write(file, _json_changed(source.read_text(encoding="utf-8"), rng))
    refused_or(lambda: read_sidecar(file))


def marker(victim: Victim, folder: Path, rng: random.Random) -> None:
    """A unit's marker or a run's manifest with anything in it."""
    (folder / "units").mkdir()
    name = rng.choice(["run.json", *(f"units/{x.name}" for x in victim.run.glob("units/*.json"))])
    text = (victim.run / name).read_text(encoding="utf-8")
    _write(folder / name, _json_changed(text, rng))
    if name == "run.json":
        refused_or(lambda: read_manifest(folder / name))
    else:
        directory = RunDirectory(folder, {})
        refused_or(lambda: directory.seconds([Path(name).stem]))
        refused_or(lambda: directory.wall_seconds([Path(name).stem]))


def specification(victim: Victim, folder: Path, rng: random.Random) -> None:
    """A specification with values, lines or characters changed."""
    file = write_spec(folder / "spec.toml")
    text = file.read_text(encoding="utf-8")
    for _ in range(rng.randint(1, 3)):
        text = rng.choice((_value_changed, _line_changed, _characters_changed))(text, rng)
    _write(file, text)
    refused_or(lambda: read_spec(file))


def constructor(victim: Victim, folder: Path, rng: random.Random) -> None:
    """An environment's arguments with any values: made and stepped, or refused."""
    names = rng.sample(ARGUMENTS, rng.randint(1, 3))
    given = {name: rng.choice(VALUES) for name in names}
    env_id = rng.choice(("IntegPendulum-v0", "IntegCartPole-v0", "IntegElasticPendulum-v0"))
    env = refused_or(lambda: gym.make(env_id, disable_env_checker=True, **given))
    if env is None:
        return
    env.action_space.seed(0)
    observation, _ = env.reset(seed=rng.randrange(1000))
    for _ in range(3):
        assert env.observation_space.contains(observation), observation
        observation, reward, over, cut, _ = env.step(env.action_space.sample())
        assert finite_number(float(reward)) is None
        if over or cut:
            break
    assert env.observation_space.contains(observation), observation


def record(victim: Victim, folder: Path, rng: random.Random) -> None:
    """A run with a record in which anything stands, and hashes that fit: named, in sentences."""
    run = victim.copied(folder / "run")
    file = rng.choice(sorted(run.glob(EVALUATED)))
    table = pq.read_table(file)
    column = table.schema.field(rng.randrange(len(table.schema)))
    values = table.column(column.name).to_pylist()
    place = rng.randrange(len(values))
    values[place] = _any_value(values[place], rng)
    kind = column.type if rng.random() < 0.9 else pa.string()
    if kind != column.type:
        values = [str(value) for value in values]
    changed = pa.field(column.name, kind, True, column.metadata)
    where = table.schema.get_field_index(column.name)
    table = table.set_column(where, changed, pa.array(values, kind)).combine_chunks()
    hashable = kind == column.type or not is_trace(column.name)
    hashed = refused_or(lambda: with_hashes(table)) if hashable else None
    pq.write_table(table if hashed is None else hashed, file)
    make_fit(run)
    name = pq.read_table(victim.run / "evidence" / file.name)["record_id"][place].as_py()
    for words in (
        ("evidence", "verify", run),
        ("report", run),
        ("evidence", "show", run, name),
        ("evidence", "export", run, "--to", rng.choice(EXPORT_FORMATS), "--out", folder / "out"),
    ):
        code, told = command(*words, *(("--no-progress",) if "export" in words else ()))
        assert code in (0, 1, 2), code
        assert "Traceback" not in told, told
        if code == 2:
            assert len(told.strip().splitlines()) == 1, told


def _any_value(value: Any, rng: random.Random) -> Any:
    """Another value of a column's type, or none."""
    if rng.random() < 0.1:
        return None
    if isinstance(value, str):
        nested = rng.choice(('{"mixture": 1}', "[[]]", '[{"dt": "x"}]', '{"dt": {"value": []}}'))
        return rng.choice((*TEXTS, nested, value[: len(value) // 2], value * 2))
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return rng.choice((0, -1, 1 << 40, value + 1))
    if isinstance(value, float):
        return rng.choice((0.0, -1.0, 1e308, math.nan, math.inf))
    if isinstance(value, list):
        others = [x for x in value if x is not None]
        kinds = ([], value[:-1], [*value, *value], [None] * len(value), value[::-1])
        return rng.choice((*kinds, [x * 0 - 7 for x in others]))
    return value


def refused_or(act: Callable[[], Any]) -> Any:
    """What an act gives; None if it is refused, which must be in one line."""
    try:
        return act()
    except (ValueError, TypeError) as error:
        told = str(error)
        assert told, "refused without a word"
        assert "\n" not in told, told
    return None


def _write(file: Path, text: str) -> None:
    """Write a text that need not be one."""
    file.write_bytes(text.encode("utf-8", "surrogatepass"))


def _member_changed(file: Path, rng: random.Random) -> bytes:
    """The zip with bytes of a member changed, and its checksum anew."""
    made = io.BytesIO()
    with zipfile.ZipFile(file) as old, zipfile.ZipFile(made, "w") as new:
        changed = rng.choice([name for name in old.namelist() if old.getinfo(name).file_size])
        for name in old.namelist():
            content = bytearray(old.read(name))
            if name == changed:
                content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
            new.writestr(name, bytes(content))
    return made.getvalue()


def _json_changed(text: str, rng: random.Random) -> str:
    if rng.random() < 0.2:
        return rng.choice((*NESTED, "", "null", "[]", "{}", "\x00", '"\\ud800"'))
    if rng.random() < 0.5:
        values = list(re.finditer(r": ?([^\s,{}\[\]]+)", text))
        found = rng.choice(values)
        new = rng.choice((*NUMBERS, *NESTED))
        return text[: found.start(1)] + new + text[found.end(1) :]
    return _characters_changed(text, rng)


def _value_changed(text: str, rng: random.Random) -> str:
    """Another value behind an equals sign."""
    found = rng.choice(list(re.finditer(r"= (.+)", text)))
    new = rng.choice((*NUMBERS, *NESTED, '"rk4"', "[0.05, 1e-12]", "[" + "0, " * 20_000 + "0]"))
    return text[: found.start(1)] + new + text[found.end(1) :]


def _line_changed(text: str, rng: random.Random) -> str:
    """A line left out, or there twice."""
    lines = text.splitlines(keepends=True)
    place = rng.randrange(len(lines))
    return "".join(
        lines[:place] + lines[place : place + 1] * rng.choice((0, 2)) + lines[place + 1 :]
    )


def _characters_changed(text: str, rng: random.Random) -> str:
    place = rng.randrange(max(1, len(text)))
    new = rng.choice(("", "\x00", "\x1b[2J", "\ud800", "é", '"', "[", "{", "=", "9" * 30))
    return text[:place] + new + text[place + rng.randint(0, 3) :]


HOSTILE: dict[str, Callable[[Victim, Path, random.Random], None]] = {
    "policy's archive": archive,
    "policy's side-car": sidecar,
    "marker or manifest": marker,
    "specification": specification,
    "constructor arguments": constructor,
    "record": record,
}
