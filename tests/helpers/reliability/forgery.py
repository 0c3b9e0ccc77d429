"""Results changed on purpose, by somebody who makes hashes, markers and the seal fit."""

from __future__ import annotations

import hashlib
import json
import random
import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from integ_gym.evidence.hashing import with_hashes
from integ_gym.evidence.schema import is_trace
from integ_gym.evidence.sealing import seal
from integ_gym.train.policy_files.card import card_hash, hashed

Names = tuple[str, ...]
"""Of what was changed, one of which must be told: record, file, policy or what is too few."""

EVALUATED = "evidence/evaluate-*.parquet"


def with_column(table: pa.Table, name: str, values: Any) -> pa.Table:
    """A table whose column holds other values."""
    field = table.schema.field(name)
    place = table.schema.get_field_index(name)
    return table.set_column(place, field, pa.array(values, field.type))


def outcome(run: Path, other: Path, rng: random.Random) -> Names:
    """Make a failure a success, or the other way round."""

    def forge(row: dict[str, Any]) -> None:
        row["success"] = not row["success"]
        if rng.random() < 0.5:  # the label too
            row["failure_label"] = "none" if row["success"] else "planning_error"

    return _one_row(run, rng, forge)


def number(run: Path, other: Path, rng: random.Random) -> Names:
    """Change a number of the outcome or the ledger."""
    name = rng.choice(("return", "work_total", "energy_end", "energy_residual_total", "length"))

    def forge(row: dict[str, Any]) -> None:
        row[name] += 1 if name == "length" else rng.choice((-1.0, 1.0)) * 10 ** rng.uniform(-4, 2)

    return _one_row(run, rng, forge)


def label(run: Path, other: Path, rng: random.Random) -> Names:
    """Say that an episode failed for another reason."""

    def forge(row: dict[str, Any]) -> None:
        others = {"evaluation_error", "discretization_error", "perception_error", "state_error"}
        row["failure_label"] = rng.choice(sorted(others - {row["failure_label"]}))

    return _one_row(run, rng, forge)


def trace(run: Path, other: Path, rng: random.Random) -> Names:
    """Move the plant at one instant."""

    def forge(row: dict[str, Any]) -> None:
        column = rng.choice(("theta", "theta_dot", "torque_applied", "energy"))
        places = range(1, len(row[column]) - 1)
        row[column][rng.choice(places)] += rng.choice((-1.0, 1.0)) * 10 ** rng.uniform(-3, 1)

    return _one_row(run, rng, forge, traced=True)


def untraced(run: Path, other: Path, rng: random.Random) -> Names:
    """Change the outcome of an episode of which no trace is kept, its label with it."""

    def forge(row: dict[str, Any]) -> None:
        row["return"] += rng.choice((-1.0, 1.0)) * 10 ** rng.uniform(-4, 2)
        if rng.random() < 0.5:
            _succeed(row)

    return _one_row(run, rng, forge, traced=False)


def trace_gone(run: Path, other: Path, rng: random.Random) -> Names:
    """Change an outcome and take the trace away that denies it."""

    def forge(row: dict[str, Any]) -> None:
        row["return"] += rng.choice((-1.0, 1.0)) * 10 ** rng.uniform(-4, 2)
        if rng.random() < 0.5:
            _succeed(row)
        for name in row:
            if is_trace(name):
                row[name] = None
        if rng.random() < 0.5:
            row["trace_every"] = 7

    return *_one_row(run, rng, forge, traced=True), "`trace_every` is recorded", "`traceless`"


def _succeed(row: dict[str, Any]) -> None:
    """A success in all that a record says of one without a trace."""
    told = {
        "success": True,
        "failure_label": "none",
        "failure_reason": "succeeded",
        "truncated": True,
    }
    row |= {**told, "failure_numbers": "{}", "terminated": False, "time_to_success": 0.5}


def moved(run: Path, other: Path, rng: random.Random) -> Names:
    """Say that all episodes of a cell were played in another."""
    names: list[str] = []

    def change(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
        policy = rng.choice(sorted({row["policy_id"] for row in rows}))
        own = [row for row in rows if row["policy_id"] == policy]
        source, target = rng.sample(sorted({row["cell"] for row in own}), 2)
        rest = [row for row in rows if row["policy_id"] != policy or row["cell"] != target]
        names.append(f"in cell {target!r}")
        return rest + [row | {"cell": target} for row in own if row["cell"] == source]

    return _rewrite(run, rng, change), *names


def dropped(run: Path, other: Path, rng: random.Random) -> Names:
    """Leave out some episodes."""

    def change(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
        gone = set(rng.sample(range(len(rows)), rng.randint(1, min(5, len(rows) - 1))))
        return [row for place, row in enumerate(rows) if place not in gone]

    return _rewrite(run, rng, change), "episodes in cell"


def doubled(run: Path, other: Path, rng: random.Random) -> Names:
    """Put some episodes there twice."""
    stem = _rewrite(run, rng, lambda rows: rows + rng.sample(rows, rng.randint(1, 5)))
    return stem, "episodes in cell"


def whose(run: Path, other: Path, rng: random.Random) -> Names:
    """Say that episodes are another policy's, or another run's."""
    field = rng.choice(("policy_hash", "run_id", "policy_id"))

    def forge(row: dict[str, Any]) -> None:
        row[field] = "0" * 64

    return *_one_row(run, rng, forge), "records of policy"


def policy(run: Path, other: Path, rng: random.Random) -> Names:
    """Put another policy in the place of one, with all its files."""
    folders = sorted(run.glob("policies/*"))
    target = rng.choice(folders)
    source = rng.choice([x for x in (*folders, *other.glob("policies/*")) if x != target])
    for name in ("policy.zip", "policy.json", "policy.safetensors"):
        shutil.copyfile(source / name, target / name)
    return (target.name,)


def foreign(run: Path, other: Path, rng: random.Random) -> Names:
    """Add a file of another run, with its marker or without."""
    source = rng.choice(sorted(other.glob("evidence/*.parquet")))
    stem = rng.choice((source.stem, f"{source.stem}-more", "foreign"))
    target = run / "evidence" / f"{stem}.parquet"
    shutil.copyfile(source, target)
    if rng.random() < 0.5:
        shutil.copyfile(other / "units" / f"{source.stem}.json", run / "units" / f"{stem}.json")
    return stem, *(folder.name for folder in other.glob("policies/*"))


def told(run: Path, other: Path, rng: random.Random) -> Names:
    """Change what ``panel.json`` says of a cell."""
    file = run / "panel.json"
    panel = json.loads(file.read_text(encoding="utf-8"))
    entry = rng.choice(panel["matrix"])
    kind = rng.choice(("rate", "count", "number", "number", "verdict"))
    if kind == "rate":
        entry["success_by_seed"][0] = 1.0 - entry["success_by_seed"][0]
    elif kind == "count":
        entry["episodes"] += 1
    elif kind == "verdict" and panel["verdicts"]:
        panel["verdicts"][0]["verdict"] = "transfers"
    else:
        name = rng.choice([name for name, held in entry.items() if _is_estimate(held)])
        end = rng.choice([end for end, held in entry[name].items() if held is not None])
        entry[name][end] += rng.choice((-1.0, 1.0)) * 10 ** rng.uniform(-4, 0)
    file.write_text(json.dumps(panel), encoding="utf-8")
    return (file.name,)


def _is_estimate(value: Any) -> bool:
    return isinstance(value, dict) and "estimate" in value


def plan(run: Path, other: Path, rng: random.Random) -> Names:
    """Change how many episodes were planned, or take the plan away."""
    file = run / "run.json"
    if rng.random() < 0.5:
        file.unlink()
        return (file.name,)
    held = json.loads(file.read_text(encoding="utf-8"))
    held["specification"]["episodes"] += rng.choice((-1, 1))
    file.write_text(json.dumps(held), encoding="utf-8")
    return ("episodes",)


def home(run: Path, other: Path, rng: random.Random) -> Names:
    """Say that a policy was trained on something else, or within other bounds."""
    file = rng.choice(sorted(run.glob("policies/*/policy.json")))
    card = json.loads(file.read_text(encoding="utf-8"))
    card["discretization"] |= {"integrator": rng.choice(("explicit_euler", "reference"))}
    card["config"]["env_arguments"] |= {"integrator": card["discretization"]["integrator"]}
    file.write_text(json.dumps(card), encoding="utf-8")
    return (file.parent.name,)


def _mend_cards(run: Path) -> None:
    """Have every side-car's hash, and what its unit's marker says of it, fit what it says."""
    for file in run.glob("policies/*/policy.json"):
        card = hashed(json.loads(file.read_text(encoding="utf-8")))
        file.write_text(json.dumps(card), encoding="utf-8")
        marker = run / "units" / f"train-{file.parent.name}.json"
        if not marker.exists():  # of a policy that was given
            continue
        held = json.loads(marker.read_text(encoding="utf-8"))
        held |= {"card": card_hash(card)} if held["policy"] == card["content_hash"] else {}
        marker.write_text(json.dumps(held), encoding="utf-8")


FORGERIES: dict[str, Callable[[Path, Path, random.Random], Names]] = {
    "forged outcome": outcome,
    "forged number": number,
    "forged label": label,
    "forged trace": trace,
    "forged outcome without a trace": untraced,
    "forged outcome, its trace removed": trace_gone,
    "rows of another cell": moved,
    "dropped rows": dropped,
    "doubled rows": doubled,
    "rows of another policy or run": whose,
    "swapped policy": policy,
    "another run's file": foreign,
    "forged panel.json": told,
    "forged plan": plan,
    "edited home": home,
}


def make_fit(run: Path, panel: bool = True) -> None:
    """Write markers, ``panel.json`` unless it is to stay, and seal for records as they are."""
    for marker in sorted(run.glob("units/*.json")):
        file = run / "evidence" / f"{marker.stem}.parquet"
        held = json.loads(marker.read_text(encoding="utf-8"))
        if "records" in held and file.exists():
            held["records"] = hashlib.sha256(file.read_bytes()).hexdigest()
            marker.write_text(json.dumps(held), encoding="utf-8")
    _mend_cards(run)
    if panel:
        _tell(run)
    seal(run)


def _tell(run: Path) -> None:
    """Have ``panel.json`` say what the records say."""
    file = run / "panel.json"
    panel = json.loads(file.read_text(encoding="utf-8"))
    names = ["policy_id", "cell", "failure_label", "phase"]
    rows = [
        row
        for records in run.glob("evidence/*.parquet")
        for row in pq.read_table(records, columns=names).to_pylist()
        if row["phase"] == "evaluation"
    ]
    policies = {row["name"]: [one["id"] for one in row["policies"]] for row in panel["rows"]}
    for entry in panel["matrix"]:
        own = [
            Counter(x["failure_label"] for x in rows if (x["policy_id"], x["cell"]) == place)
            for place in ((policy, entry["cell"]) for policy in policies[entry["row"]])
        ]
        entry["labels"] = dict(sum(own, Counter()))
        entry["episodes"] = sum(entry["labels"].values())
        entry["success_by_seed"] = [one["none"] / max(1, one.total()) for one in own]
    file.write_text(json.dumps(panel), encoding="utf-8")


def _one_row(
    run: Path,
    rng: random.Random,
    forge: Callable[[dict[str, Any]], None],
    traced: bool | None = None,
) -> Names:
    """Change one record of an evaluation, with or without a trace if that is asked for; its id."""
    changed: list[str] = []

    def change(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
        row = rng.choice([x for x in rows if traced in (None, x["reward"] is not None)])
        forge(row)
        changed.append(row["record_id"])
        return rows

    _rewrite(run, rng, change)
    return (changed[0],)


def _rewrite(
    run: Path,
    rng: random.Random,
    change: Callable[[list[dict[str, Any]]], list[dict[str, Any]]],
) -> str:
    """Change the rows of a file of evaluations, with content hashes that fit; the file's stem."""
    file = rng.choice(sorted(run.glob(EVALUATED)))
    table = pq.read_table(file)
    rows = change(table.to_pylist())
    changed = pa.Table.from_pylist(rows, table.schema)
    pq.write_table(with_hashes(changed.combine_chunks()), file)
    return file.stem
