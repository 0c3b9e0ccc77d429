"""The experiments beside the atlas: they run, go on where they stopped, and are told as found."""

import sys

import pytest
from house import ROOT

EXPERIMENTS = ("control_periods", "curriculum", "fresh_points", "q_learning_periods")
EXPLANATION = ROOT / "docs" / "explanation"
PAGES = dict.fromkeys(EXPERIMENTS, EXPLANATION / "experiments.md")
PAGES["fresh_points"] = EXPLANATION / "atlas.md"


@pytest.fixture(params=EXPERIMENTS)
def experiment(request, monkeypatch):
    """A script, and what it is made of."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    __import__(request.param)
    yield sys.modules[request.param], sys.modules["measuring.trained"]
    for name in [name for name in sys.modules if name.split(".")[0] in ("measuring", *EXPERIMENTS)]:
        del sys.modules[name]


def test_the_page_tells_what_was_found(experiment):
    script, trained = experiment
    done = trained.read(ROOT / "docs" / "atlas" / f"{script.__name__}.json")
    assert set(done) == {unit.name for unit in script.EXPERIMENT.units()}
    page = PAGES[script.__name__].read_text(encoding="utf-8")
    for table in script.tables(done).strip().split("\n\n"):
        assert table in page


@pytest.mark.slow
def test_every_arm_trains(experiment, monkeypatch):
    script, trained = experiment
    monkeypatch.setattr(trained, "TOGETHER", 2)
    if script.__name__ == "curriculum":
        monkeypatch.setitem(script.TRAINING, "total_steps", 16_384)
    elif script.__name__ == "fresh_points":
        monkeypatch.setitem(script._atlas().panel.training, "total_steps", 16_384)
    else:
        monkeypatch.setattr(script, "SECONDS", min(script.SECONDS / 10.0, 800.0))
    for arm in script.EXPERIMENT.arms:
        found = script.run(trained.Unit(script.EXPERIMENT.values[-2], arm, 1900))
        assert len(found) == 2
        assert all(0 <= count <= trained.STARTS for count in found)
