"""Results that others measured: intervals, comparisons and losses that need no simulation."""

from __future__ import annotations

import difflib
import itertools
import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias

import numpy as np
from msgspec.structs import replace

from integ_gym.support.errors import InputError, translate_errors
from integ_gym.support.files import read_bounded, read_json
from integ_gym.support.optional import load, package_version
from integ_gym.support.pages import page_parts
from integ_gym.support.terminal import fixed, plural

from . import statistics as stats
from . import verdict
from .report.forests import RATE_AXIS, Axis, Line, Mark, difference_axis, value_axis
from .report.page import report_environment

MEASURES: Final = ("success", "return")
"""What is measured of an episode; the first that both have is compared."""

COLUMNS: Final = ("policy", "seed", "episode", "condition", "home", *MEASURES)
"""Columns of a table of results, one line an episode; `policy` and a measure are needed."""

_NEEDED: Final = "name its columns policy, seed, episode, condition, and success or return"
_NEAR: Final = 0.75
"""Likeness from which on a column is taken for a misspelt one."""

STATUS_WORDS: Final = {
    "shown": "shown", "undecided": "not shown", "unsolved": "neither succeeds",
    "too_few_seeds": f"fewer than {verdict.MIN_SEEDS} each",
}  # fmt: skip
"""Of a difference; the last two are uninformative, as in `compare_policies`."""

Status: TypeAlias = Literal["shown", "undecided", "unsolved", "too_few_seeds"]
Row: TypeAlias = dict[str, Any]
"""An episode: `COLUMNS` to values, of which ``seed`` and what was not measured may be None."""
Rows: TypeAlias = Sequence[Row]


class Judged(stats.Part, frozen=True):
    """A policy in a condition; intervals are over seeds, or over the episodes of one seed."""

    policy: str
    condition: str
    seeds: int
    episodes: int
    estimates: dict[str, stats.Estimate]


class Compared(stats.Part, frozen=True, kw_only=True):
    """A difference, first minus second.

    Attributes:
        first, second: policies in a condition, or home and another condition of a policy.
        place: the condition, or the policy.
        measure: what is compared.
        means: of both.
        difference: with its 95 % interval.
        p: two-sided p-value.
        p_adjusted: after Holm's procedure over the informative comparisons of its kind.
        status: what it shows at the level of 0.05.
        difficulty: of a loss, what policies trained in the condition lose too; null: unknown.
        rest: of a loss, what is left: deadline and overfitting together.
    """

    first: str
    second: str
    place: str
    measure: str
    means: tuple[float, float]
    difference: stats.Estimate
    p: float
    p_adjusted: float
    status: Status
    difficulty: stats.Estimate | None = None
    rest: stats.Estimate | None = None


class Judgement(stats.Part, frozen=True):
    """Each policy in each condition, what differs between policies, and what is lost."""

    judged: tuple[Judged, ...]
    policies: tuple[Compared, ...]
    losses: tuple[Compared, ...]


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
        found += _checked(rows, path)
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


def _checked(rows: Rows, path: Path) -> list[Row]:
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


def judge(rows: Rows, home: str | None = None) -> Judgement:
    """Judge episodes of which nothing but the outcome is known.

    Args:
        rows: of at least one policy; see `read_results`.
        home: condition that policies were trained in, where rows do not say it.

    Raises:
        ValueError: if a policy has several homes, or nothing was judged there.
    """
    cells: dict[tuple[str, str], list[Row]] = defaultdict(list)
    homes: dict[str, str] = {}
    for row in rows:
        cells[row["policy"], row["condition"]].append(row)
        own = row["home"] or home
        if own is not None and homes.setdefault(row["policy"], own) != own:
            raise InputError(f"{row['policy']} has the homes {homes[row['policy']]} and {own}")
    names, places = (list(dict.fromkeys(parts)) for parts in zip(*cells, strict=True))
    if unknown := sorted({*homes.values()} - {*places}):
        raise InputError(
            f"nothing was judged in {unknown[0]!r}; home is one of {', '.join(places)}"
        )
    pairs = [
        _compare(cells[a, place], cells[b, place], a, b, place)
        for place in places
        for a, b in itertools.combinations(names, 2)
        if {(a, place), (b, place)} <= {*cells}
    ]
    losses = [
        _lose(cells, homes, policy, place)
        for policy, place in list(cells)
        if homes.get(policy, place) != place and (policy, homes[policy]) in cells
    ]
    return Judgement(
        tuple(_judge_cell(*place, own) for place, own in cells.items()),
        _decide([one for one in pairs if one]),
        _decide([one for one in losses if one]),
    )


def by_seed(rows: Rows, measure: str) -> dict[Any, stats.Floats]:
    """Values of every training seed; empty where some were not measured."""
    found = defaultdict(list)
    for row in rows:
        found[row["seed"]].append(row[measure])
    whole = all(row[measure] is not None for row in rows)
    return {seed: np.array(own, dtype=np.float64) for seed, own in found.items()} if whole else {}


def units(rows: Rows, measure: str) -> stats.Floats:
    """Values of the units of replication: means of training seeds, or episodes of one seed."""
    seeds = list(by_seed(rows, measure).values())
    return seeds[0] if len(seeds) == 1 else np.array([stats.mean_of(own) for own in seeds])


def _judge_cell(policy: str, condition: str, rows: Rows) -> Judged:
    rates, returns = (units(rows, measure) for measure in MEASURES)
    found = {
        "success": stats.rate_interval(rates, draws=stats.draws_for(rates.size))
        if rates.size
        else None,
        "return": stats.mean_interval(returns),
    }
    known = {measure: estimate for measure, estimate in found.items() if estimate}
    return Judged(policy, condition, len({row["seed"] for row in rows}), len(rows), known)


def _compare(first: Rows, second: Rows, a: str, b: str, place: str) -> Compared | None:
    """A difference that is not adjusted yet; None where nothing was measured of both.

    Seeds of one policy in two conditions are paired; episodes are not, whose starts may differ.
    """
    for measure in MEASURES:
        one, other = units(first, measure), units(second, measure)
        if not (one.size and other.size):
            continue
        few = min(one.size, other.size) < verdict.MIN_SEEDS
        status: Status = "too_few_seeds" if few else "undecided"
        if measure == "success":
            cell = verdict.PolicyCell(place, one, other)
            status = verdict.uninformative(cell) or "undecided"
            draws = stats.draws_for(max(one.size, other.size))
            paired = _paired_seeds(first, second)
            found = (
                stats.paired_difference(*paired)
                if paired
                else stats.unpaired_difference(one, other, draws=draws)
            )
            interval, p = found.interval, min(1.0, 2.0 * min(found.p_greater(), found.p_less()))
        else:
            interval, p = stats.unpaired_return(one, other)
        return Compared(
            first=a, second=b, place=place, measure=measure,
            means=(stats.mean_of(one), stats.mean_of(other)),
            difference=interval, p=p, p_adjusted=p, status=status,
        )  # fmt: skip
    return None


def _paired_seeds(first: Rows, second: Rows) -> tuple[stats.Floats, stats.Floats] | None:
    """Rates of one policy's seeds in two conditions; None of two policies, or of one seed."""
    one, other = by_seed(first, "success"), by_seed(second, "success")
    if first[0]["policy"] != second[0]["policy"] or {*one} != {*other} or len(one) < 2:
        return None
    rates = [np.array([stats.mean_of(own[seed]) for seed in one]) for own in (one, other)]
    return rates[0], rates[1]


def _lose(
    cells: Mapping[tuple[str, str], Rows], homes: Mapping[str, str], policy: str, place: str
) -> Compared | None:
    """What a policy loses elsewhere; split where its seeds and natives are known."""
    own, away = cells[policy, homes[policy]], cells[policy, place]
    found, rates = _compare(own, away, homes[policy], place, policy), _paired_seeds(own, away)
    natives = [
        units(cells[other, place], "success")
        for other, its in homes.items()
        if its == place and (other, place) in cells
    ]
    if found is None or rates is None or not any(native.size for native in natives):
        return found
    loss = verdict.split(verdict.Rates(*rates, rates[1], np.concatenate(natives)))
    return replace(found, difficulty=loss.difficulty, rest=loss.overfitting)


def _decide(found: Sequence[Compared]) -> tuple[Compared, ...]:
    """The same with p-values adjusted over those that are informative, and what they show."""
    adjusted = iter(stats.holm([one.p for one in found if one.status == "undecided"]).tolist())
    decided = []
    for one in found:
        p = next(adjusted) if one.status == "undecided" else one.p
        shown = one.status == "undecided" and p < verdict.ALPHA
        decided.append(replace(one, p_adjusted=p, status="shown" if shown else one.status))
    return tuple(decided)


def answer_of(found: Judgement) -> str:
    """The answer in one sentence: the largest loss, else the clearest difference."""
    if found.losses:
        one = max(found.losses, key=lambda one: (one.measure, one.difference.estimate))
        return (
            f"{one.measure.title()} of {one.place} at home ({one.first}) {fixed(one.means[0])}, in "
            f"{one.second} {fixed(one.means[1])}, lost {_tested(one)}; whether dt is the cause "
            "takes a simulation."
        )
    if found.policies:
        one = min(found.policies, key=lambda one: (one.p_adjusted, -abs(one.difference.estimate)))
        return (
            f"{one.measure.title()} in {one.place}: {one.first} {fixed(one.means[0])}, "
            f"{one.second} {fixed(one.means[1])}, difference {_tested(one)}."
        )
    own = found.judged[0]
    words = [f"{name} {value.in_words(level=True)}" for name, value in own.estimates.items()]
    return f"{own.policy} in {own.condition}: {', '.join(words) or 'one return'}."


def _tested(one: Compared) -> str:
    words = one.difference.in_words(level=True, more=verdict.p_text(one.p_adjusted))
    return f"{words}: {STATUS_WORDS[one.status]}"


def limitations(found: Judgement) -> list[str]:
    """What the results cannot say, each in a sentence with what would."""
    single = sorted({one.policy for one in found.judged if one.seeds == 1})
    compared = (*found.policies, *found.losses)
    few = sorted({one.place for one in compared if one.status == "too_few_seeds"})
    split = [one for one in found.losses if one.rest]
    lines = {
        "Starts are not known to be the same, so a difference holds their luck too. Which starts "
        "are lost, and the exact test over pairs of them, take `integ-gym evaluate`.": True,
        "Why an episode failed, and whether dt is the cause, takes a simulation: `integ-gym "
        "evaluate` or `integ-gym check`.": True,
        f"Of {', '.join(single)} one training seed was judged: the intervals are over episodes "
        "and say nothing about other seeds.": single,
        f"Nothing is concluded in {', '.join(few)}: it takes {verdict.MIN_SEEDS} training seeds, "
        f"or {verdict.MIN_SEEDS} episodes of single ones.": few,
        "No home is known, so nothing is called a loss: give --home CONDITION, or a column home.":
        not found.losses,
        "A loss is split into a harder task and the rest only where several seeds were judged, of "
        "policies trained in the condition too.": len(split) < len(found.losses),
        "No episode went on beyond its horizon, so the rest holds what more time would win back.":
        split,
    }  # fmt: skip
    return [line for line, applies in lines.items() if applies]


def render_judgement(found: Judgement, command: str) -> str:
    """The page of a judgement: one HTML file that opens offline.

    Raises:
        ModuleNotFoundError: if jinja2 is not installed, with the command that installs it.
    """
    text = resources.files(__package__).joinpath("judge.html.j2").read_text("utf-8")
    page: str = report_environment().from_string(text).render(
        **page_parts(),
        answer=answer_of(found),
        forests=list(_forests(found)),
        limitations=limitations(found),
        command=command,
        version=package_version("integ-gym"),
    )  # fmt: skip
    return page


def _forests(found: Judgement) -> Iterator[tuple[str, Axis, list[Line]]]:
    """Title, axis and lines of each figure of the page."""
    for name in MEASURES:
        judged = [one for one in found.judged if name in one.estimates]
        values = [one.estimates[name] for one in judged]
        lines = [
            _line(one.policy, one.condition, value,
                  f"{plural(one.seeds, 'seed')}, {plural(one.episodes, 'episode')}")
            for one, value in zip(judged, values, strict=True)
        ]  # fmt: skip
        yield name.title(), RATE_AXIS if name == "success" else value_axis(values), lines
        axis = difference_axis if name == "success" else value_axis
        for title, group in (("Lost from home", found.losses), ("Policies", found.policies)):
            own = [one for one in group if one.measure == name]
            lines = [
                _line(one.place, f"{one.first} − {one.second}", one.difference, _note(one))
                for one in own
            ]
            yield f"{title}: {name}", axis([one.difference for one in own]), lines


def _note(one: Compared) -> str:
    split = {"difficulty": one.difficulty, "rest": one.rest}
    parts = [f"{name} {value}" for name, value in split.items() if value]
    return ", ".join([STATUS_WORDS[one.status], verdict.p_text(one.p_adjusted), *parts])


def _line(row: str, cell: str, value: stats.Estimate, note: str) -> Line:
    ends = " to ".join(map(fixed, value.ends)) if value.bounded else ""
    return Line(
        row, cell, (row, cell), (Mark(value, "accent"),), fixed(value.estimate), ends,
        f"{row}, {cell}: {value}", note,
    )  # fmt: skip
