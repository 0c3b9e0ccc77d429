"""Nothing that happens to a run, by accident or on purpose, changes a result unnoticed.

`benchmarks/attacks.py` tries the same attacks as often as is wanted.
"""

import pyarrow.parquet as pq
import pytest
from damage import DAMAGES
from forgery import FORGERIES, make_fit
from hostile import HOSTILE
from interruption import INTERRUPTIONS
from leaves import Leaf, change_records
from trials import tried
from victim import Victim, command, make_victim

FILES = [f"file {kind}" for kind in DAMAGES]
PLAIN = list(FORGERIES)
OF_ONE_LEAF = {"number", "label", "trace", "panel.json", "plan"}
"""What is forged in these is one leaf, each of which `test_every_leaf.py` changes."""
FITTING = [
    f"{kind}, all made to fit"
    for kind in FORGERIES
    if kind.removeprefix("forged ") not in OF_ONE_LEAF
]
STRANGERS = [f"hostile {kind}" for kind in HOSTILE]


@pytest.fixture(scope="session")
def victim(made_once):
    """Finished runs, of which every try has a copy of its own."""
    return Victim(made_once("victim", make_victim))


def _holds(name, seeds, victim, folder):
    for seed in seeds:
        outcome = tried(name, seed, victim, folder / "try")
        assert outcome.held, (seed, outcome)


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file_is_named_and_nothing_is_made_of_it(name, victim, tmp_path):
    _holds(name, range(1), victim, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*PLAIN[:1], *FITTING])
def test_a_forgery_is_named_and_nothing_is_made_of_it(name, victim, tmp_path):
    _holds(name, range(1), victim, tmp_path)


@pytest.mark.slow
def test_what_a_record_cannot_hold_is_one_finding_among_others(victim, tmp_path):
    """A perturbation that is no JSON, and an outcome that the trace denies."""
    run = victim.copied(tmp_path / "run")
    path = min(run.glob("evidence/evaluate-*.parquet")).relative_to(run).as_posix()
    rows = pq.read_table(run / path, columns=["record_id", "reward"]).to_pylist()
    traced = next(k for k, row in enumerate(rows) if k and row["reward"] is not None)
    broken = (("added", 0, "perturbation"), ("changed", traced, "return"))
    change_records(run, [Leaf("", "", how, path, tuple(where)) for how, *where in broken])
    make_fit(run)
    code, told = command("evidence", "verify", run, "--all", "--no-progress")
    assert code == 1
    for number, column in ((0, "perturbation"), (traced, "return")):
        assert f"{rows[number]['record_id']}: `{column}`" in told
    assert "not replayed" in told
    code, told = command("report", run)
    assert code == 2
    assert told.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", STRANGERS)
def test_what_a_stranger_gives_is_read_or_refused(name, victim, tmp_path):
    _holds(name, range(15 if name == "hostile record" else 25), victim, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", INTERRUPTIONS)
def test_a_disturbed_run_is_finished_without_loss(name, victim, tmp_path):
    _holds(name, range(2 if name == "killed" else 1), victim, tmp_path)
