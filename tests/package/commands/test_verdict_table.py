"""After a panel: one table that fits, failing first."""

from __future__ import annotations

import io

import pytest
from report_pages import panel_of

from integ_gym.commands.printed import TONES, print_verdicts
from integ_gym.eval.power import WITHOUT_VERDICT
from integ_gym.support.terminal import fixed


@pytest.mark.parametrize("width", [80, 120])
def test_every_verdict_is_told_once_and_fits(width, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(width))
    panel, file = panel_of("full"), io.StringIO()
    print_verdicts(panel, file)
    lines = file.getvalue().splitlines()
    assert max(map(len, lines)) <= width
    told = "".join(file.getvalue().split())
    assert panel.verdicts
    for judged in panel.verdicts:
        assert judged.verdict in told
        assert fixed(judged.overfitting.estimate) in told
        assert fixed(judged.total.estimate) in told
    below = lines[next(k for k, line in enumerate(lines) if line.startswith("---")) + 1 :]
    first = [line.split()[0] for line in below if not line.startswith(" ")]
    order = ["fails", "transfers", "inconclusive", *WITHOUT_VERDICT]
    assert first == sorted(first, key=order.index)
    assert len(first) == len(panel.verdicts)


def test_every_verdict_has_a_tone():
    assert set(TONES) == {"fails", "transfers", "inconclusive", *WITHOUT_VERDICT}
