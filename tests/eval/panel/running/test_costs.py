"""What a panel is told to cost and how it is divided, before anything runs."""

from __future__ import annotations

import pytest
from shared_panel import specification

from integ_gym.cli import main
from integ_gym.eval.panel.costs import fixed_cost, policy_costs, total_cost
from integ_gym.eval.panel.plan import with_seed_count
from integ_gym.eval.panel.run import specified
from integ_gym.eval.panel.run_directory import RunDirectory
from integ_gym.eval.panel.spec import read_spec
from integ_gym.eval.panel.training import waiting_chunks
from integ_gym.eval.panel.units import trained_units
from integ_gym.train.fleet.worker import Workers


@pytest.mark.slow
def test_storage_is_that_of_a_run(undisturbed, tmp_path):
    """Within a third: a run as small as this is all but its files' heads."""
    spec = specified(specification(tmp_path))
    told = total_cost([*policy_costs(spec), fixed_cost(spec)]).storage
    folders = ("evidence", "policies")
    held = sum(f.stat().st_size for name in folders for f in (undisturbed / name).rglob("*.*"))
    assert 0.67 < told / held < 1.5


def test_the_command_tells_it_and_runs_nothing(tmp_path, capsys):
    words = ["panel", str(specification(tmp_path)), "--plan", "--workers", "8"]
    before = sorted(tmp_path.iterdir())
    assert main(words) == 0
    told = capsys.readouterr().out
    assert sorted(tmp_path.iterdir()) == before
    assert "4 policies and 1 baseline" in " ".join(told.split())
    for count in ("4 (this panel)", "10 ", "1,000", "100,000"):
        assert any(line.startswith(count) for line in told.splitlines()), count
    assert "on 8 workers" in told
    assert main([*words, "--policies", str(tmp_path)]) == 0
    trained, judged = (_hours(text) for text in (told, capsys.readouterr().out))
    assert trained[0] > judged[0] == 0.0
    assert trained[1] == judged[1] == judged[2]
    assert 3600.0 * min(trained[:2]) > 8.0  # compilation and the page, however little is computed


def _hours(told: str) -> list[float]:
    """Core hours of training, of evaluation and together, of the panel itself."""
    (line,) = (line for line in told.splitlines() if "(this panel)" in line)
    return [float(cell) for cell in line.partition("(this panel)")[2].split()[:3]]


TWO, MANY = Workers(2, "cpu"), Workers(64, "cpu")


def _names(chunks):
    return [[unit.policy for unit in chunk] for chunk in chunks]


def test_who_is_trained_together_stays_whoever_goes_on(tmp_path):
    """Growing adds to it; another number of workers changes nothing."""
    spec = read_spec(specification(tmp_path))
    directory = RunDirectory(tmp_path / "run", spec.to_json())
    with directory.opened():
        first = _names(waiting_chunks(spec, directory, TWO, 3.0))
        assert _names(waiting_chunks(spec, directory, MANY, 96.0)) == first
        more = with_seed_count(spec, 4)
        assert _names(waiting_chunks(more, directory, MANY, 96.0))[: len(first)] == first
        assert sorted(p for chunk in first for p in chunk) == sorted(
            unit.policy for unit in trained_units(spec)
        )
        directory.finish_work()
        assert _names(waiting_chunks(spec, directory, MANY, 96.0)) != first
