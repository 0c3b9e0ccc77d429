"""A run whose files were touched is named by `verify`, and built on by nothing."""

import json
import shutil
import subprocess

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from forgery import make_fit

from integ_gym.cli import main
from integ_gym.eval.panel.run_directory import (
    RunDirectory,
    Seen,
    hash_of_looks,
    spent_by,
)
from integ_gym.eval.verdict import Shares
from integ_gym.evidence.fields import SCHEMA_VERSION, SUMMARY_FIELDS
from integ_gym.evidence.hashing import with_hashes
from integ_gym.evidence.schema import VERSION_KEY
from integ_gym.evidence.sealing import seal
from integ_gym.train.policy_files.card import hashed


def _rewrite(file, change):
    """Records changed, with hashes that fit."""
    table = change(pq.read_table(file))
    pq.write_table(with_hashes(table.combine_chunks()), file)


def _flipped(table):
    place = table.schema.get_field_index("success")
    values = pa.array([not x for x in table.column("success").to_pylist()])
    return table.set_column(place, table.schema.field(place), values)


def _another_policy(run):
    one, other = sorted(run.glob("policies/*"))[:2]
    for name in ("policy.zip", "policy.json", "policy.safetensors"):
        shutil.copy(other / name, one / name)


def _edited(run, mend=lambda card: card):
    """Another home and another limit of the motor, in a side-car."""
    file = next(run.glob("policies/*/policy.json"))
    card = json.loads(file.read_text())
    card["config"]["env_arguments"] |= {"integrator": "rk4", "max_torque": 9.0}
    file.write_text(json.dumps(mend(card)))


def _unhashed(card):
    """As side-cars were before they had a hash of themselves."""
    return {k: x for k, x in card.items() if k != "card_hash"} | {"format": "integ-gym policy 1"}


def _evaluation(run):
    return next(run.glob("evidence/evaluate-*.parquet"))


ATTACKS = {
    "forged outcome": (lambda run: _rewrite(_evaluation(run), _flipped), "unit was finished with"),
    "deleted file": (lambda run: _evaluation(run).unlink(), "is missing"),
    "swapped policy": (_another_policy, "is not the policy that this run was made with"),
    "edited home": (_edited, "was edited after it was written"),
    "edited home, hash mended": (lambda run: _edited(run, hashed), "is not the policy that this"),
    "edited home, hash removed": (lambda run: _edited(run, _unhashed), "is not the policy that"),
}  # fmt: skip


def _verify(run, capsys, *words):
    """Exit code of verifying a run up to its seal, and what was told."""
    given = words or ("--depth", "sealed")
    return main(["evidence", "verify", str(run), "--no-progress", *given]), capsys.readouterr().out


@pytest.mark.parametrize("attack", ATTACKS)
def test_what_was_touched_is_named_and_not_told_and_no_new_seal_hides_it(run, attack, capsys):
    change, message = ATTACKS[attack]
    change(run)
    assert main(["report", str(run)]) == 2
    assert "run the panel's command again" in capsys.readouterr().err
    for _ in range(2):
        code, told = _verify(run, capsys)
        assert code == 1
        assert message in told
        seal(run)


def test_a_finished_run_is_whole_sealed_and_replayed_by_its_policies(run, capsys):
    code, told = _verify(run, capsys, "--all", "--exact", "--policy")
    assert code == 0
    (line,) = (line for line in told.splitlines() if line.startswith("replayed: "))
    files = [*run.glob("evidence/evaluate-*.parquet"), *run.glob("evidence/achieve-*.parquet")]
    evaluated = sum(pq.read_metadata(file).num_rows for file in files)
    assert line.startswith(f"replayed: {evaluated} of ")
    assert f"{evaluated} of them to the last bit" in line
    assert "of training or of a policy without a hash" in told


@pytest.mark.slow
def test_the_page_quotes_the_seal_while_it_holds(run, capsys):
    pinned = json.loads((run / "seal.json").read_text())["seal"]
    assert pinned in (run / "report.html").read_text()
    (run / "seal.json").unlink()
    assert main(["report", str(run)]) == 0
    assert pinned not in (run / "report.html").read_text()
    code, told = _verify(run, capsys, "--sample", "0")
    assert code == 1
    assert "seal.json: is missing: the run is not finished, or" in told
    assert _verify(run, capsys, "--depth", "whole")[0] == 0
    assert main(["evidence", "verify", str(run), "--depth", "sealed"]) == 2
    assert "has no seal.json" in capsys.readouterr().err


@pytest.mark.slow
def test_a_panel_is_signed_at_its_end_and_stays_so_when_it_is_run_again(
    run, again, tmp_path, capsys
):
    key = tmp_path / "key"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(key)], check=True)
    assert again(run, "--sign", str(key)) == 0
    assert "Signed by SHA256:" in capsys.readouterr().out
    public = ("--depth", "sealed", "--public-key", str(key.with_suffix(".pub")))
    assert _verify(run, capsys, *public)[0] == 0
    names = ("seal.json", "seal.json.sig", "panel.json", "run.json")
    before = {name: (run / name).read_bytes() for name in names}
    assert again(run) == 0
    assert {name: (run / name).read_bytes() for name in names} == before
    assert not list(run.glob(".*"))
    assert again(run, "--sign", str(tmp_path / "none")) == 2


@pytest.mark.slow
def test_a_page_from_before_it_told_of_falls_is_read_and_verified_as_it_is(run, capsys):
    """No entry has what came later; where some have it, it was taken out of the others."""
    file = run / "panel.json"
    panel = json.loads(file.read_text())
    for entries, code in ((panel["matrix"][1:], 1), (panel["matrix"][:1], 0)):
        for entry in entries:
            del entry["command_error"], entry["terminated"]
        file.write_text(json.dumps(panel))
        seal(run)
        assert _verify(run, capsys)[0] == code
    assert main(["report", str(run)]) == 0


def test_a_unit_that_is_gone_with_its_marker_and_file_is_named(run, capsys):
    gone = ["evaluate-random*", "achieve-explicit_euler-dt-0.05*"]
    for file in (x for name in gone for x in [*run.glob(f"*/{name}.json"), *run.glob(f"*/{name}")]):
        file.unlink(missing_ok=True)
    (run / "seal.json").unlink()
    seal(run)
    code, told = _verify(run, capsys)
    assert code == 1
    assert "units: policy 'random', which the plan has, is not evaluated" in told
    assert "units: achieve-explicit_euler-dt-0.05.json is missing, which the plan has" in told
    assert "no episode is missing" not in told


@pytest.mark.parametrize("version", [1, 3])
def test_records_of_an_earlier_schema_are_no_way_round_what_is_asked_now(run, version, capsys):
    """Earlier versions kept less, so that less is asked of them: the run is not one of theirs."""
    for file in run.glob("evidence/*.parquet"):
        table = pq.read_table(file)
        table = table.drop_columns([x.name for x in SUMMARY_FIELDS if x.since > version])
        for name, value in (
            ("schema_version", version),
            ("package_versions", json.dumps({"integ-gym": "0.9.0"})),
        ):
            place = table.schema.get_field_index(name)
            values = pa.array([value] * table.num_rows, table.schema.field(place).type)
            table = table.set_column(place, table.schema.field(place), values)
        told = table.schema.metadata | {VERSION_KEY: str(version).encode()}
        pq.write_table(with_hashes(table.replace_schema_metadata(told)), file)
    make_fit(run, panel=False)
    seal(run)
    words = (
        f"records of schema version {version} in a run of the version that writes {SCHEMA_VERSION}"
    )
    code, told = _verify(run, capsys)
    assert (code, words in told) == (1, True)
    manifest = run / "run.json"
    held = json.loads(manifest.read_text())
    held["versions"]["integ-gym"] = "0.9.0"  # the page tells
    manifest.write_text(json.dumps(held))
    seal(run)
    code, told = _verify(run, capsys)
    assert (code, words in told) == (1, True)


def test_no_look_is_dropped_by_units_that_do_not_say_after_which_they_were_finished(run, capsys):
    """Nor does it help that all of them are silent."""
    for marker in run.glob("units/*.json"):
        held = json.loads(marker.read_text())
        del held["after"]
        marker.write_text(json.dumps(held))
    seal(run)
    code, told = _verify(run, capsys)
    assert code == 1
    assert told.count("`looks` are not those after which unit") > 3
    assert main(["report", str(run)]) == 2


@pytest.mark.slow
def test_a_panel_with_policies_of_another_inherits_its_looks(run, again, tmp_path, capsys):
    """Whoever looks at policies again pays for the looks of before."""
    other = tmp_path / "other"
    assert again(other, "--policies", str(run)) == 0
    seen = json.loads((run / "run.json").read_text())["looks"]
    (before, now) = json.loads((other / "run.json").read_text())["looks"]
    assert [{k: x for k, x in before.items() if k != "spent"}] == seen == [now]
    looks = json.loads((other / "panel.json").read_text())["looks"]
    assert [look["adopted"] for look in looks] == [True, False]
    assert _verify(other, capsys)[0] == 0
    kept = [file for file in run.glob("policies/*/*") if file.is_file()]
    for file in [*kept, *run.glob("evidence/train-*")]:
        assert (other / file.relative_to(run)).read_bytes() == file.read_bytes()
    for marker in run.glob("units/train-*"):
        held = json.loads(marker.read_text())
        found = json.loads((other / "units" / marker.name).read_text())
        assert {**found, "after": held["after"]} == {**held, "adopted": True}
    ours, theirs = (json.loads((one / "panel.json").read_text()) for one in (other, run))
    assert "--policies" in ours["command"]
    assert ours["cost"]["train_seconds"] == 0.0 < ours["cost"]["evaluate_seconds"]
    assert [e["success_by_seed"] for e in ours["matrix"]] == [
        e["success_by_seed"] for e in theirs["matrix"]
    ]
    gone = other / "policies" / "explicit_euler-dt-0.05-seed1" / "policy.zip"
    gone.unlink()
    assert again(other, "--policies", str(run)) == 0
    assert gone.exists()
    assert json.loads((other / "run.json").read_text())["looks"] == [before, now]
    RunDirectory(other, {}).note(looks=[now])
    seal(other)
    assert _verify(other, capsys)[0] == 1


def test_what_looks_spent_goes_with_their_policies(tmp_path):
    """Whatever rule they were spent by: here the one planned look."""
    runs = [RunDirectory(tmp_path / name, {"looks": [33]}) for name in ("one", "two", "three")]
    for directory in runs:
        directory.make_folders()
        plan = {"specification": {"looks": [33]}, "versions": {}}
        (directory.path / "run.json").write_text(json.dumps(plan))
    one, two, three = runs
    one.record_look(Seen(33, 20, 0))
    two.inherit_looks(one)
    two.inherit_looks(one)
    assert two.looks() == [Seen(33, 20, 0, (1.0, 1.0))]
    two.record_look(Seen(33, 20, 0))
    assert spent_by(two.looks(), [33]) == [Shares(1.0, 1.0), Shares(0.0, 0.0)]
    three.inherit_looks(two)
    assert three.looks() == [Seen(33, 20, 0, (1.0, 1.0)), Seen(33, 20, 0, (0.0, 0.0))]


def test_a_look_that_is_dropped_is_named(run, capsys):
    """Units that are finished after a look say so."""
    (marker,) = run.glob("units/evaluate-random*.json")
    held = json.loads(marker.read_text())
    assert held["after"] == hash_of_looks([]), "this was before the first look"
    directory = RunDirectory(run, {})
    looks = [{"seeds": seeds, "episodes": 3, "natives": 0} for seeds in (1, 2)]
    directory.note(looks=looks)
    directory.finish("train-late", "key", 0.0, policy="p")
    late = json.loads((run / "units" / "train-late.json").read_text())
    assert list(directory.lost_looks()) == []
    (run / "units" / "train-late.json").unlink()
    marker.write_text(json.dumps(held | {"after": late["after"]}))
    directory.note(looks=looks[1:])
    (run / "seal.json").unlink()
    seal(run)
    code, told = _verify(run, capsys)
    assert code == 1
    assert f"run.json: `looks` are not those after which unit {marker.stem} says" in told


@pytest.mark.parametrize("attack", [x for x in ATTACKS if x.startswith("edited")])
def test_no_panel_takes_policies_that_were_touched(run, again, attack, tmp_path, capsys):
    ATTACKS[attack][0](run)
    assert again(tmp_path / "other", "--policies", str(run)) == 2
    assert "restore it" in capsys.readouterr().err


@pytest.mark.parametrize("attack", ["forged outcome", "swapped policy", "edited home"])
def test_a_panel_builds_on_nothing_that_was_touched(run, again, attack, capsys):
    ATTACKS[attack][0](run)
    assert again(run) == 2
    assert "restore it" in capsys.readouterr().err
