"""Files of results that others measured, as rows of one form."""

from __future__ import annotations

import difflib
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeAlias

from integ_gym.support.errors import InputError, translate_errors
from integ_gym.support.files import read_bounded, read_json
from integ_gym.support.optional import load

MEASURES: Final = ("success", "return")
"""What is measured of an episode; the first that both have is compared."""

COLUMNS: Final = ("policy", "seed", "episode", "condition", "home", *MEASURES)
"""Columns of a table of results, one line an episode; `policy` and a measure are needed."""

_NEEDED: Final = "name its columns policy, seed, episode, condition, and success or return"
_NEAR: Final = 0.75
"""Likeness from which on a column is taken for a misspelt one."""

Row: TypeAlias = dict[str, Any]
"""An episode: `COLUMNS` to values, of which ``seed`` and what was not measured may be None."""
Rows: TypeAlias = Sequence[Row]


def read_results(words: Sequence[str]) -> Rows:
    """Episodes of files.

    Args:
        words: paths of tables (``.csv``, ``.parquet``, or ``.json`` as a list of objects), of
            LeRobot's ``eval_info.json`` or of what Isaac Lab's ``robust_eval.py`` writes;
            ``NAME=PATH`` names the policy of a file that names none; an ``eval_info.json`` has the
            name of its folder. Files of one name are training seeds of one policy.

    Raises:
        ValueError: in one sentence with the remedy, for a file of another form.
    """
    found: list[Row] = []
    seeds: Counter[str] = Counter()
    for word in dict.fromkeys(words):
        name, _, rest = word.rpartition("=")
        path = Path(rest)
        if not path.is_file():
            raise InputError(f"there is no file {path}; give a table of results, or NAME=FILE")
        rows = _read(path)
        if path.name == "eval_info.json":
            name = name or path.absolute().parent.name
        if name and rows and "policy" not in rows[0]:
            rows = [{"policy": name, "seed": seeds[name], **row} for row in rows]
        found += _check_rows(rows, path)
        seeds[name] += 1
    return found


def _read(path: Path) -> list[Row]:
    if path.suffix in (".csv", ".parquet"):
        kind = path.suffix[1:]
        with translate_errors(f"cannot read {path}; save it again as CSV or Parquet"):
            module = load(f"pyarrow.{kind}", "report")
            table = module.read_csv(path) if kind == "csv" else module.read_table(path)
            return list(table.to_pylist())
    if path.suffix != ".json":
        return list(_isaac_lab_rows(read_bounded(path).decode(errors="replace"), path))
    content = read_json(path, "write it again")
    if isinstance(content, dict):
        return list(_lerobot_rows(content, path))
    if not isinstance(content, list) or not all(isinstance(row, dict) for row in content):
        raise InputError(f"{path} holds no list of objects; {_NEEDED}")
    return content


def _lerobot_rows(content: Mapping[str, Any], path: Path) -> Iterator[Row]:
    """Of ``lerobot-eval``: lists for each task, in earlier versions an entry for each episode."""
    try:
        for task in content.get("per_task", ()):
            both = task["metrics"]["successes"], task["metrics"]["sum_rewards"]
            for pair in zip(*both, strict=True):
                place = f"{task['task_group']} {task['task_id']}"
                yield {"condition": place, **dict(zip(MEASURES, pair, strict=True))}
        for one in content.get("per_episode", ()):
            yield {"success": one["success"], "return": one["sum_reward"]}
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{path} is no whole eval_info.json of lerobot-eval; {_NEEDED}") from None


_ISAAC_LAB: Final = re.compile(
    r"Evaluation setting: (?P<condition>\S+)|\[Model: (?P<policy>.+)\] Trial \d+: (?P<success>\w+)"
)


def _isaac_lab_rows(text: str, path: Path) -> Iterator[Row]:
    """Of Isaac Lab's ``robust_eval.py``; the seed in the file's name is that of the starts."""
    condition = None
    for found in filter(None, map(_ISAAC_LAB.match, text.splitlines())):
        condition = found["condition"] or condition
        if found["policy"]:
            success = found["success"] == "True"
            yield {"policy": found["policy"], "condition": condition, "success": success}
    if condition is None:
        raise InputError(f"{path} is no .csv, .parquet, .json or log of robust_eval.py; {_NEEDED}")


def _check_rows(rows: Rows, path: Path) -> list[Row]:
    columns = list(rows[0]) if rows else []
    for column in {*columns} - {*COLUMNS}:
        near = difflib.get_close_matches(column, {*COLUMNS} - {*columns}, 1, _NEAR)
        if near:
            raise InputError(f"{path} has a column {column!r}; name it {near[0]!r}")
    if "policy" not in columns or not {*MEASURES} & {*columns}:
        lacks = "column policy" if {*MEASURES} & {*columns} else "success and no return"
        raise InputError(f"{path} has no {lacks if rows else 'episode'}; {_NEEDED}")
    numbered = Counter(tuple(str(row.get(name)) for name in COLUMNS[:4]) for row in rows)
    for key, count in numbered.items():
        if count > 1 and "episode" in columns:
            raise InputError(f"{path} has {', '.join(key)} {count} times; number the episodes")
    return [
        {
            "policy": str(row["policy"]),
            "seed": row.get("seed"),
            "condition": str(row.get("condition") or "all"),
            "home": row.get("home"),
            **{name: _number(row, name, path, place) for name in MEASURES},
        }
        for place, row in enumerate(rows, 1)
    ]


def _number(row: Row, name: str, path: Path, place: int) -> float | None:
    if name not in row:
        return None
    try:
        number = float(row[name])
    except (TypeError, ValueError):
        number = math.nan
    if math.isfinite(number) and (name != "success" or 0.0 <= number <= 1.0):
        return number
    wanted = "true, false or a share from 0 to 1" if name == "success" else "a finite number"
    raise InputError(
        f"{path} has {name} {row[name]!r} in row {place}, not {wanted}; mend it or leave it out"
    )
