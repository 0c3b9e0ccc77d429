"""What is in a run's directory only while it is worked on."""

from __future__ import annotations

from integ_gym.eval.panel.running.staging import WORK, clear
from integ_gym.support.sharing.probing import PROBE


def test_only_what_was_for_the_work_is_removed(tmp_path):
    for folder in (WORK, f"{PROBE}of-a-killed-worker", "evidence", ".kept"):
        (tmp_path / folder / "inner").mkdir(parents=True)
    (tmp_path / "run.json").write_text("{}", encoding="utf-8")
    clear(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"evidence", ".kept", "run.json"}
