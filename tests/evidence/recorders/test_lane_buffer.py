"""The lanes' rows are gathered as they were added, whatever ends when."""

from __future__ import annotations

import numpy as np
import pytest

from integ_gym.evidence.episodes import EpisodeHeads
from integ_gym.evidence.vector_recorder import LaneBuffer

ENTRIES, HORIZON = 3, 30


class _Listed:
    """The same in lists: rows of the lanes' episodes, in the order in which they end."""

    def __init__(self, lanes):
        self.under_way = [[] for _ in range(lanes)]
        self.ended = []

    def begin(self, lanes, first):
        for lane, row in zip(lanes, first.T, strict=True):
            self.under_way[lane] = [row]

    def add(self, rows):
        for lane, row in enumerate(rows.T):
            self.under_way[lane].append(row)

    def end(self, lanes):
        self.ended += [self.under_way[lane] for lane in lanes]


def _heads(lanes):
    """Heads that tell the lanes by their index."""
    lanes = np.asarray(lanes).tolist()
    nothing = [0] * len(lanes)
    return EpisodeHeads(lanes, [None] * len(lanes), [""] * len(lanes), *[nothing] * 4)


def _compare(buffer, listed):
    for _ in range(2):
        rows, counts, heads = buffer.gathered()
        assert counts.tolist() == [len(episode) for episode in listed.ended]
        np.testing.assert_array_equal(rows.T, np.concatenate(listed.ended))
        assert len(heads) == buffer.episodes == len(listed.ended)
    buffer.forget()
    assert buffer.waiting == buffer.episodes == 0
    listed.ended = []


@pytest.mark.parametrize("lanes", [1, 2, 5, 64])
@pytest.mark.parametrize("wait", [1, 400, 10**9])
def test_episodes_that_end_at_random(lanes, wait):
    rng = np.random.default_rng([lanes, wait % 1000])
    buffer, listed = LaneBuffer(ENTRIES, lanes, HORIZON), _Listed(lanes)
    begun, gathered = np.arange(lanes), 0
    lengths = np.zeros(lanes, dtype=int)
    for _ in range(500):
        if len(begun):
            first = rng.random((ENTRIES, len(begun)))
            buffer.begin(begun, first, np.ones(len(begun), dtype=bool))
            listed.begin(begun, first)
            lengths[begun] = 0
        if buffer.full and listed.ended:
            _compare(buffer, listed)
            gathered += 1
        rows = rng.random((ENTRIES, lanes))
        buffer.add(rows)
        listed.add(rows)
        lengths += 1
        begun = np.flatnonzero((rng.random(lanes) < 0.1) | (lengths == HORIZON))
        if len(begun):
            buffer.end(begun, _heads(begun))
            listed.end(begun)
        assert buffer.waiting == sum(map(len, listed.ended))
        if buffer.waiting >= wait:
            _compare(buffer, listed)
            gathered += 1
    assert gathered > 3


@pytest.mark.parametrize("lanes", [3, 128])
def test_episodes_that_end_together(lanes):
    rng = np.random.default_rng(lanes)
    buffer, listed = LaneBuffer(ENTRIES, lanes, HORIZON), _Listed(lanes)
    everyone = np.arange(lanes)
    for _ in range(4):
        first = rng.random((ENTRIES, lanes))
        buffer.begin(everyone, first, np.ones(lanes, dtype=bool))
        listed.begin(everyone, first)
        for _ in range(HORIZON):
            rows = rng.random((ENTRIES, lanes))
            buffer.add(rows)
            listed.add(rows)
        buffer.end(everyone, _heads(everyone))
        listed.end(everyone)
        _compare(buffer, listed)


def test_only_what_is_recorded_is_kept():
    buffer = LaneBuffer(ENTRIES, 2, HORIZON)
    buffer.begin(np.arange(2), np.zeros((ENTRIES, 2)), np.array([True, False]))
    assert buffer.active.tolist() == [True, False]
    for number in range(HORIZON):
        buffer.add(np.full((ENTRIES, 2), number))
    buffer.end(np.flatnonzero(buffer.active), _heads([0]))
    assert not buffer.active.any()
    rows, counts, heads = buffer.gathered()
    assert (counts.tolist(), heads.index) == ([HORIZON + 1], [0])
    assert rows[0, 1:].tolist() == list(range(HORIZON))


def test_what_waits_is_never_written_over():
    buffer = LaneBuffer(ENTRIES, 1, HORIZON)
    buffer.begin(np.arange(1), np.zeros((ENTRIES, 1)), np.ones(1, dtype=bool))
    buffer.add(np.ones((ENTRIES, 1)))
    buffer.end(np.arange(1), _heads([0]))
    while not buffer.full:
        buffer.add(np.full((ENTRIES, 1), 2.0))
    with pytest.raises(BufferError, match="gather them first"):
        buffer.add(np.full((ENTRIES, 1), 3.0))
    assert buffer.gathered()[0].tolist() == [[0.0, 1.0]] * ENTRIES
