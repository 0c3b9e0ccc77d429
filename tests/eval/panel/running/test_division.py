"""Who is trained together is decided once, for whoever goes on."""

from __future__ import annotations

from shared_panel import specification

from integ_gym.eval.panel.plan import with_seed_count
from integ_gym.eval.panel.run_directory import RunDirectory
from integ_gym.eval.panel.spec import read_spec
from integ_gym.eval.panel.training import waiting_chunks
from integ_gym.eval.panel.units import trained_units
from integ_gym.train.fleet.worker import Workers

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
