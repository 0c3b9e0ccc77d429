"""Every leaf of every file of a finished run, each changed once by somebody who makes all else fit.

A leaf is a value, a key or a column. Places that differ in an index or a name alone are one kind of
leaf: ``units/train-*.json`` is a kind of file, ``seeds[]`` a kind of place.
"""

from __future__ import annotations

import base64
import copy
import datetime as dt
import hashlib
import io
import json
import pickle
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from integ_gym.evidence.hashing import with_hashes
from integ_gym.evidence.schema import is_trace

JSON_COLUMNS = (
    *("engine_description", "arguments", "training_discretization", "perturbation"),
    "package_versions",
)
"""Columns of text that hold JSON."""

GIVEN = "given policies/*/policy.json"
"""The side-car of a policy that was not trained in its run."""

_MARKS = {"key added": ".+", "gone": ".-"}
"""What is another kind of place there: what is left out may be silent where what is said is not."""

_FITTED = {
    **dict.fromkeys(("policies/*/policy.json", GIVEN), ("card_hash",)),
    "units/train-*.json": ("card", "records"),
}
"""Hashes that are made to fit, so that a change of them does not stay."""


@dataclass(frozen=True)
class Leaf:
    """One change of one leaf.

    Attributes:
        file: kind of file, a pattern of its path in the run.
        place: kind of place in it.
        change: what is done to it.
        path: the file that is changed, from the run.
        keys: where in the file; of records the row and the column, then the place in its JSON.
    """

    file: str
    place: str
    change: str
    path: str
    keys: tuple[Any, ...]

    @property
    def kind(self) -> tuple[str, str]:
        """File and place, as a list of leaves names them."""
        return self.file, self.place

    def __str__(self) -> str:
        return f"{self.file} {self.place} ({self.change})"


def file_kind(run: Path, path: str) -> str:
    """The kind of a run's file."""
    path = re.sub(r"^units/(\w+)-.*\.json$", r"units/\1-*.json", path)
    path = re.sub(r"^policies/[^/]+/", "policies/*/", path)
    given = path.startswith("policies/") and not any(run.glob("units/train-*"))
    return f"given {path}" if given else path


# Files of JSON


def json_leaves(run: Path, names: Sequence[str], every: bool) -> list[Leaf]:
    """The leaves of all JSON of a run but its seal.

    Args:
        run: the run.
        names: of rows, cells and policies, which stand for each other as keys.
        every: all leaves; else one of each kind.
    """
    found: dict[tuple[Any, ...], Leaf] = {}
    for file in sorted((*run.glob("*.json"), *run.glob("units/*"), *run.glob("policies/*/*.json"))):
        path = file.relative_to(run).as_posix()
        if path == "seal.json":
            continue
        kind = file_kind(run, path)
        held = json.loads(file.read_text(encoding="utf-8"))
        for keys, value in (((), held), *_walk(held)):
            place = _place(keys, names) or "top"
            if place in _FITTED.get(kind, ("records",)):
                continue
            for change in changes_of(value, keys):
                mark = _MARKS.get(change, "") if kind == GIVEN else ""
                leaf = Leaf(kind, f"{place}{mark}", change, path, keys)
                found.setdefault(
                    (leaf.path, leaf.keys, change) if every else (*leaf.kind, change), leaf
                )
    return list(found.values())


def _walk(value: Any, keys: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    if keys:
        yield keys, value
    inner = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    for key, one in inner:
        yield from _walk(one, (*keys, key))


def _place(keys: tuple[Any, ...], names: Sequence[str]) -> str:
    told = ["[]" if isinstance(key, int) else "*" if key in names else str(key) for key in keys]
    return ".".join(told).replace(".[]", "[]")


def changes_of(value: Any, keys: tuple[Any, ...]) -> list[str]:
    """What can be done to a value; to a whole file, no more than to add a key."""
    if not keys:
        return ["key added"]
    if isinstance(value, dict):
        own = ["other kind", "key added"]
    elif isinstance(value, list):
        own = ["other kind", "entry twice"] if value else ["other kind", "entry added"]
    elif value is None:
        own = ["number", "text"]
    else:
        own = ["changed", "null", "other kind"]
    return own if isinstance(keys[-1], int) else [*own, "gone"]


def change_json(held: Any, keys: tuple[Any, ...], change: str) -> None:
    """Do it, in place."""
    if not keys:
        held.update(changed(held, change))
        return
    *before, last = keys
    for key in before:
        held = held[key]
    if change == "gone":
        del held[last]
    else:
        held[last] = changed(held[last], change)


def changed(value: Any, change: str) -> Any:
    """A value after a change."""
    if change == "null":
        return None
    if change == "number":
        return 1
    if change == "text":
        return "x"
    if change == "other kind":
        return 7 if isinstance(value, str | list | dict) else "x"
    if change == "key added":
        return {**value, "zz": 1}
    if change == "entry added":
        return [1]
    if change == "entry twice":
        return [*value, copy.deepcopy(value[-1])]
    return other(value)


def other(value: Any) -> Any:
    """Another value of the same type."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    if isinstance(value, float):
        return value + 0.1 * max(1.0, abs(value))
    if isinstance(value, str):
        with suppress(ValueError):
            return (dt.datetime.fromisoformat(value) + dt.timedelta(days=1)).isoformat()
        return f"{value}x"
    raise TypeError(f"{value!r} is no leaf")


# Records


def record_kind(row: Mapping[str, Any]) -> str:
    """What a record is: phase, whether of the fleet, which plays none again, and of a trace."""
    trace = "traced" if row["reward"] is not None else "untraced"
    fleet = "fleet " if row["float_width"] == 32 else ""
    return f"records of {fleet}{row['phase']}, {trace}"


def record_leaves(run: Path, every: bool) -> list[Leaf]:
    """The leaves of all records; each change of a kind is of a row of its own if there are enough.

    Args:
        run: the run.
        every: also each kind of change at home and abroad, perturbed and not, of policies and
            baselines; else one of each.
    """
    leaves: list[Leaf] = []
    rows: dict[str, list[tuple[str, int, dict[str, Any]]]] = {}
    nullable: set[str] = set()
    for file in sorted(run.glob("evidence/*.parquet")):
        path = file.relative_to(run).as_posix()
        table = pq.read_table(file)
        nullable.update(field.name for field in table.schema if field.nullable)
        for number, row in enumerate(table.to_pylist()):
            kind = record_kind(row)
            if every:
                about = "perturbed" if row["perturbation"] else "plain"
                about += ", trained" if row["training_discretization"] else ", not trained"
                kind = f"{kind}; {about}"
            rows.setdefault(kind, []).append((path, number, row))
    for kind, own in rows.items():
        count = 0
        columns = {name for *_, row in own for name in row}
        for name in sorted(columns):
            for keys, change in _column_changes(name, [row for *_, row in own]):
                if change == "null" and not keys and name not in nullable:
                    continue  # no file can hold it
                fit = [x for x in own if _fits(x[2], name, keys, change)]
                path, number, _ = fit[count % len(fit)]
                count += 1
                place = name if not keys else f"{name}:{_place(keys, ())}"
                file = kind.partition(";")[0]
                leaves.append(Leaf(file, place, change, path, (number, name, *keys)))
    return leaves


def _column_changes(
    name: str, rows: Sequence[Mapping[str, Any]]
) -> Iterator[tuple[tuple[Any, ...], str]]:
    """What is done to a column's values: place in its JSON, and the change."""
    values = [row[name] for row in rows]
    told = [x for x in values if x is not None]
    if name == "content_hash":
        return
    if is_trace(name):
        yield from (
            ((), change)
            for change in (("changed", "null", "shorter", "nan") if told else ("added",))
        )
        return
    if told:
        yield (), "changed"
        yield (), "null"
    if len(told) < len(values):
        yield (), "added"
    if name in JSON_COLUMNS and told:
        yield from (((), change) for change in ("no JSON", "other JSON"))
        seen = set()
        for text in told:
            for keys, value in _walk(json.loads(text)):
                for change in changes_of(value, keys):
                    if (_place(keys, ()), change) not in seen:
                        seen.add((_place(keys, ()), change))
                        yield keys, change


def _fits(row: Mapping[str, Any], name: str, keys: tuple[Any, ...], change: str) -> bool:
    value = row[name]
    if change == "added" and not keys:
        return value is None
    if value is None:
        return False
    if not keys:
        return True
    inner = json.loads(value)
    try:
        for key in keys:
            inner = inner[key]
    except (LookupError, TypeError):
        return False
    return change in changes_of(inner, keys)


def change_row(row: dict[str, Any], keys: tuple[Any, ...], change: str, kind: Any) -> None:
    """Change a column of a row, in place.

    Args:
        row: the record.
        keys: column, and place in its JSON.
        change: what is done.
        kind: Arrow type of the column.
    """
    name, *inner = keys
    value = row[name]
    if inner:
        told = json.loads(value)
        change_json(told, tuple(inner), change)
        row[name] = json.dumps(told, sort_keys=True, separators=(",", ":"))
    elif change == "null":
        row[name] = None
    elif change == "no JSON":
        row[name] = value[:-1] + "{"
    elif change == "other JSON":
        row[name] = "[7]"
    elif change == "shorter":
        row[name] = value[:-1]
    elif change == "nan":
        row[name] = [float("nan") if pa.types.is_floating(kind.value_type) else 99, *value[1:]]
    elif change == "added":
        row[name] = _made(kind)
    elif is_trace(name):
        middle = len(value) // 2
        row[name] = [*value[:middle], _other(value[middle]), *value[middle + 1 :]]
    elif isinstance(value, list):
        row[name] = [other(value[0]), *value[1:]]
    else:
        row[name] = _other(value)


def _other(value: Any) -> Any:
    if value is None:
        return 1
    return value + dt.timedelta(seconds=7) if isinstance(value, dt.datetime) else other(value)


def _made(kind: Any) -> Any:
    types = pa.types
    if types.is_list(kind):
        return [1]
    if types.is_boolean(kind):
        return True
    return "x" if types.is_string(kind) else 1


def row_after(rows: Sequence[dict[str, Any]], schema: Any, leaf: Leaf) -> dict[str, Any]:
    """A leaf's row of a table, as it is after the change."""
    number, *keys = leaf.keys
    row = dict(rows[number])
    change_row(row, tuple(keys), leaf.change, schema.field(keys[0]).type)
    return row


def change_records(run: Path, leaves: Sequence[Leaf]) -> None:
    """Change records of a run, with content hashes that fit."""
    for path in sorted({leaf.path for leaf in leaves}):
        file = run / path
        table = pq.read_table(file)
        rows = table.to_pylist()
        for leaf in leaves:
            if leaf.path == path:
                rows[leaf.keys[0]] = row_after(rows, table.schema, leaf)
        made = pa.Table.from_pylist(rows, table.schema)
        pq.write_table(with_hashes(made.combine_chunks()), file)


_PHASES = ("train", "evaluate")


def schema_leaves(run: Path) -> list[Leaf]:
    """Metadata of every column, and of the file, of one file of each phase."""
    leaves = []
    for file in (next(iter(sorted(run.glob(f"evidence/{x}-*.parquet"))), None) for x in _PHASES):
        if file is None:
            continue
        path = file.relative_to(run).as_posix()
        schema, kind = pq.read_schema(file), "schema of evidence/*.parquet"
        told = [(f.name, key) for f in schema for key in f.metadata or {}]
        for name, key in (*told, *(("", key) for key in schema.metadata or {})):
            if not key.startswith(b"PARQUET:"):
                of = "file" if not name else "trace" if is_trace(name) else "field"
                place = f"{of}.{key.decode()}"
                about = (schema.field(name) if name else schema).metadata[key]
                own = ("changed", "gone") if about else ("changed",)
                leaves += [Leaf(kind, place, x, path, (name, key)) for x in own]
    return leaves


def change_schema(run: Path, leaf: Leaf) -> None:
    """Change the metadata of a column or of the file, with content hashes that fit."""
    file = run / leaf.path
    table = pq.read_table(file)
    name, key = leaf.keys

    def edited(about: Mapping[bytes, bytes]) -> dict[bytes, bytes]:
        rest = {k: v for k, v in about.items() if k != key}
        return rest if leaf.change == "gone" else {**rest, key: about[key] + b"x"}

    schema = table.schema
    if name:
        place = schema.get_field_index(name)
        field = schema.field(place)
        schema = schema.set(place, field.with_metadata(edited(field.metadata)))
    else:
        schema = schema.with_metadata(edited(schema.metadata))
    made = pa.Table.from_arrays(table.columns, schema=schema)
    pq.write_table(with_hashes(made.combine_chunks()), file)


# Policies as stable-baselines3 saves them


_SERIALIZED = ":serialized:"


class _Evil:
    def __reduce__(self) -> Any:
        return print, ("run by whoever reads it",)


def zip_leaves(run: Path) -> list[Leaf]:
    """Members of one published zip, what its JSON says, and members that are no one's."""
    file = sorted(run.glob("policies/*/policy.zip"))[0]
    path, kind = file.relative_to(run).as_posix(), "policies/*/policy.zip"
    leaves = [Leaf(kind, "pickle", "added", path, ("extra.pkl",))]
    with zipfile.ZipFile(file) as held:
        for name in held.namelist():
            leaves += [Leaf(kind, name, x, path, (name,)) for x in ("changed", "gone")]
            if name.endswith(".pth"):
                leaves.append(Leaf(kind, f"pickle in {name}", "pickle", path, (name,)))
        data = json.loads(held.read("data"))
    for keys, value in _walk(data):
        if len(keys) > 1 and keys[-1] != _SERIALIZED:
            continue
        place = f"data:{_place(keys, ())}"
        if keys[-1] == _SERIALIZED:
            leaves.append(Leaf(kind, f"pickle in {place}", "pickle", path, ("data", *keys)))
        for x in changes_of(value, keys):  # what is added describes a value, and is none
            told = f"{place}.*" if x == "key added" else place
            leaves.append(Leaf(kind, told, x, path, ("data", *keys)))
    return leaves


def change_zip(run: Path, leaf: Leaf) -> None:
    """Change a zip; its side-car says its new hash."""
    file = run / leaf.path
    with zipfile.ZipFile(file) as held:
        members = {name: held.read(name) for name in held.namelist()}
    name, *keys = leaf.keys
    if keys:
        data = json.loads(members["data"])
        if keys[-1] == _SERIALIZED and leaf.change in ("pickle", "changed"):
            part = data
            for key in keys[:-1]:
                part = part[key]
            content = pickle.dumps(_Evil() if leaf.change == "pickle" else 7)
            part[_SERIALIZED] = base64.b64encode(content).decode()
        else:
            change_json(data, tuple(keys), leaf.change)
        members["data"] = json.dumps(data).encode()
    elif leaf.change in ("added", "pickle"):
        members[name] = pickle.dumps(_Evil())
    elif leaf.change == "gone":
        del members[name]
    else:
        members[name] = _edited(members[name])
    with zipfile.ZipFile(file, "w") as made:
        for own, content in members.items():
            made.writestr(own, content)
    card = file.with_name("policy.json")
    told = json.loads(card.read_text(encoding="utf-8"))
    told["zip_hash"] = hashlib.sha256(file.read_bytes()).hexdigest()
    card.write_text(json.dumps(told), encoding="utf-8")


def _edited(content: bytes) -> bytes:
    """Another content: of an archive, its largest member with one bit flipped in the middle."""
    if content[:2] != b"PK":
        return content[:-2] + b"x" + content[-1:]
    with zipfile.ZipFile(io.BytesIO(content)) as held:
        members = [(info, held.read(info)) for info in held.infolist()]
    largest = max(
        (k for k, (info, _) in enumerate(members) if "/data/" in info.filename),
        key=lambda k: len(members[k][1]),
        default=len(members) - 1,
    )
    info, own = members[largest]
    middle = len(own) // 2
    members[largest] = info, own[:middle] + bytes([own[middle] ^ 1]) + own[middle + 1 :]
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        for info, own in members:
            archive.writestr(info, own)
    return made.getvalue()
