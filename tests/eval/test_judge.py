"""Results that others measured: numbers are those of the statistics, refusals name the remedy."""

import csv
import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from house import ROOT, page_blocks

from integ_gym.cli import main
from integ_gym.eval import statistics as stats
from integ_gym.eval import verdict
from integ_gym.eval.judge import judge, limitations
from integ_gym.eval.result_files import read_results
from integ_gym.support.errors import InputError

PLACES = {"sim": (0.95, 0.7), "real": (0.2, 0.9)}
HOMES = {"act": "sim", "dp": "real"}


@pytest.fixture
def rows():
    draw = np.random.default_rng(3).random
    return [
        {"policy": policy, "seed": seed, "episode": k, "condition": place, "home": home,
         "success": bool(draw() < rates[i]), "return": float(draw())}
        for i, (policy, home) in enumerate(HOMES.items())
        for place, rates in PLACES.items()
        for seed in range(8)
        for k in range(10)
    ]  # fmt: skip


def write_csv(path: Path, rows: Iterable[dict]) -> Path:
    rows = list(rows)
    with path.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return path


def rates(rows, policy, place, measure="success"):
    own = [row for row in rows if (row["policy"], row["condition"]) == (policy, place)]
    return [np.mean([row[measure] for row in own if row["seed"] == seed]) for seed in range(8)]


def test_numbers_are_those_of_the_statistics(rows):
    found = judge(rows)
    for one in found.judged:
        own = rates(rows, one.policy, one.condition)
        assert one.estimates["success"] == stats.rate_interval(own)
        returns = rates(rows, one.policy, one.condition, "return")
        assert one.estimates["return"].low == pytest.approx(stats.mean_interval(returns).low)
        assert (one.seeds, one.episodes) == (8, 80)
    for one in found.policies:
        pair = [rates(rows, policy, one.place) for policy in (one.first, one.second)]
        assert one.difference == stats.unpaired_difference(*pair).interval
    assert {one.place: one.status for one in found.policies}["real"] == "shown"
    (lost,) = (one for one in found.losses if one.place == "act")
    home, away = rates(rows, "act", "sim"), rates(rows, "act", "real")
    assert lost.difference == stats.paired_difference(home, away).interval
    assert lost.status == "shown"
    split = verdict.split(verdict.Rates(home, away, away, rates(rows, "dp", "real")))
    assert (lost.difficulty, lost.rest) == (split.difficulty, split.overfitting)
    for group in (found.policies, found.losses):
        assert [one.p_adjusted for one in group] == stats.holm([one.p for one in group]).tolist()


def test_one_seed_is_judged_by_its_episodes_which_are_not_paired(rows):
    single = [row for row in rows if row["seed"] == 0 and row["policy"] == "act"]
    by_place = {p: [r["success"] for r in single if r["condition"] == p] for p in PLACES}
    found = judge(single)
    assert found.judged[0].estimates["success"] == stats.rate_interval(by_place["sim"])
    (lost,) = found.losses
    assert lost.difference == stats.unpaired_difference(by_place["sim"], by_place["real"]).interval
    assert lost.rest is None
    assert any("act" in line for line in limitations(found))


def test_returns_alone_are_compared_and_few_seeds_show_nothing(rows):
    bare = [{**row, "success": None, "home": None} for row in rows]
    (first, _) = judge(bare).policies
    pair = [rates(rows, policy, "sim", "return") for policy in HOMES]
    assert first.measure == "return"
    difference, p = stats.unpaired_return(*pair)
    assert (*first.difference.ends, first.p) == pytest.approx((*difference.ends, p))
    few = judge([row for row in bare if row["seed"] < verdict.MIN_SEEDS - 1])
    assert {one.status for one in few.policies} == {"too_few_seeds"}
    assert not few.losses


def test_welch_differs_by_chance_alone_as_often_as_it_says():
    draw = np.random.default_rng(0).normal
    shown = [
        stats.unpaired_return(draw(size=6), draw(scale=3, size=9))[1] < 0.05 for _ in range(800)
    ]
    assert 0.03 < np.mean(shown) < 0.07
    assert stats.unpaired_return([1.0], [2.0, 3.0]) == (stats.Estimate(-1.5), 1.0)


def lerobot(successes: list[bool]) -> dict:
    metrics = {"sum_rewards": [float(s) for s in successes], "successes": successes}
    tasks = [{"task_group": "pusht", "task_id": 0, "metrics": metrics}]
    return {"per_task": tasks, "per_group": {}, "overall": {"n_episodes": len(successes)}}


def test_the_same_episodes_are_read_from_every_form(rows, tmp_path):
    table = write_csv(tmp_path / "table.csv", rows)
    pq.write_table(pa.Table.from_pylist(rows), tmp_path / "table.parquet")
    (tmp_path / "table.json").write_text(json.dumps(rows))
    forms = [table, tmp_path / "table.parquet", tmp_path / "table.json"]
    read = [judge(read_results([str(form)])) for form in forms]
    assert read[0] == read[1] == read[2] == judge(rows)

    outcomes = [True, False, True]
    new, old = tmp_path / "act" / "eval_info.json", tmp_path / "old.json"
    new.parent.mkdir()
    new.write_text(json.dumps(lerobot(outcomes)))
    episodes = [{"success": s, "sum_reward": float(s), "seed": 7} for s in outcomes]
    old.write_text(json.dumps({"per_episode": episodes, "aggregated": {}}))
    isaac = tmp_path / "results_seed_101"
    isaac.write_text(
        "Evaluation setting: vanilla\n=====\n"
        + "".join(f"[Model: m_1000.pth] Trial {k}: {s}\n" for k, s in enumerate(outcomes))
        + "[Model: m_1000.pth] Success rate: 0.66\nEvaluation setting: all\n"
        "[Model: m_1000.pth] Trial 0: False\n\nResults Summary (success rate):\n"
    )
    for words, seeds, places in (
        ([str(new)], {0}, [("act", "pusht 0")] * 3),
        ([f"x={new}", f"x={old}"], {0, 1}, [("x", "pusht 0")] * 3 + [("x", "all")] * 3),
        ([str(isaac)], {None}, [("m_1000.pth", "vanilla")] * 3 + [("m_1000.pth", "all")]),
    ):
        found = read_results(words)
        assert [(row["policy"], row["condition"]) for row in found] == places
        assert [row["success"] for row in found][:3] == [1.0, 0.0, 1.0]
        assert {row["seed"] for row in found} == seeds


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"policy": None}, "no column policy"),
        ({"success": None, "return": None}, "success or return"),
        ({"conditon": "a"}, "name it 'condition'"),
        ({"success": 85.0}, "share from 0 to 1"),
        ({"success": "yes"}, "share from 0 to 1"),
        ({"return": "nan"}, "finite"),
        ({"episode": 3}, "number the episodes"),
    ],
)
def test_bad_columns_are_refused_with_the_remedy(change, told, tmp_path, capsys):
    rows = [{"policy": "a", "episode": k, "success": 1, "return": 2.0} for k in range(2)]
    rows = [{k: v for k, v in (row | change).items() if v is not None} for row in rows]
    path = write_csv(tmp_path / "r.csv", rows)
    assert main(["judge", str(path), "--out", str(tmp_path / "out")]) == 2
    error = " ".join(capsys.readouterr().err.split())
    assert told in error
    assert str(path) in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "text"),
    [("r.txt", "hello"), ("r.json", "3"), ("r.json", "{}"), ("r.csv", ""),
     ("r.json", '{"per_task": [{"task_id": 0}]}'), ("r.parquet", "no")],
)  # fmt: skip
def test_other_files_are_refused(name, text, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=name):
        read_results([str(tmp_path / name)])


@pytest.mark.parametrize(("homes", "told"), [(("x",) * 2, "nothing was judged"), ("ab", "homes")])
def test_a_home_is_one_condition_that_was_judged(homes, told):
    row = {"policy": "p", "seed": None, "success": 1.0, "return": None}
    with pytest.raises(InputError, match=told):
        judge([{**row, "condition": c, "home": h} for c, h in zip("ab", homes, strict=True)])


def test_the_command_leaves_what_it_prints(rows, tmp_path, capsys):
    path = write_csv(
        tmp_path / "r.csv", ({k: v for k, v in r.items() if k != "home"} for r in rows)
    )
    out = tmp_path / "out"
    assert main(["judge", str(path), "--home", "sim", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    content = json.loads((out / "judge.json").read_text())
    worst = max(content["losses"], key=lambda one: one["difference"]["estimate"])
    assert f"lost {worst['difference']['estimate']:.2f}" in printed.splitlines()[0]
    page = (out / "judge.html").read_text()
    for line in limitations(judge(read_results([str(path)]), "sim")):
        assert line.split(":")[0].split(".")[0] in " ".join(page.split())
    assert page.count('class="dot"') == 2 * len(content["judged"]) + len(content["losses"]) + len(
        content["policies"]
    )


def test_the_example_of_its_page(tmp_path, monkeypatch, capsys):
    page = "docs/how-to/judge.md"
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    monkeypatch.chdir(tmp_path)
    (block,) = page_blocks(page, "python")
    exec(block, {})
    table, answer = page_blocks(page, "text")[:2]
    assert Path("results.csv").read_text(encoding="utf-8").startswith(table.partition("…")[0])
    command = next(x for x in page_blocks(page, "sh") if "results.csv" in x)
    main(command.split()[1:])
    said = capsys.readouterr().out
    parts = [part.strip("\n") for part in answer.split("…")]
    assert all(part in said for part in parts)
