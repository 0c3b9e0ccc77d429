"""Units are held by one process at a time, and each is committed once, whatever happens."""

from __future__ import annotations

import os
import random
import shutil
import threading
import time
from collections import Counter
from itertools import islice

import pytest

from integ_gym.support.sharing.claims import BLOCK, MOST_NUMBER, ClaimError, Claims, was_committed
from integ_gym.support.sharing.folder_files import FolderFiles, Gone
from integ_gym.support.sharing.holding import held, pauses

LEASE = 1000.0
UNITS = ("a", "b dt-0.05", "c")


@pytest.fixture
def files(tmp_path):
    return FolderFiles(tmp_path)


def _claims(files, units=UNITS, seed=0, lease=LEASE, clock=time.monotonic):
    return Claims(files, units, lease, seed, clock)


def _silent_for(files, name, seconds):
    """Have a claim's holder been silent for so long, by the file system's clock."""
    path, now = files.root / name, time.time()
    os.utime(path, (now - seconds, now - seconds))


def _all(claims):
    found = []
    while (claim := claims.take()) is not None:
        found.append(claim)
    return found


def test_every_unit_is_held_once(files):
    first, second = _claims(files), _claims(files, seed=1)
    one, *rest = (first.take(), *_all(second))
    assert sorted(claim.unit for claim in (one, *rest)) == sorted(UNITS)
    assert {claim.number for claim in (one, *rest)} == {1}
    assert first.take() is None
    assert not first.done


def test_all_is_done_once_all_is_finished(files):
    claims, late = _claims(files), _claims(files, seed=1)
    for claim in _all(claims):
        assert claim.commit()
        claim.finish()
    for seen in (claims, late):
        assert seen.take() is None
        assert seen.done
    assert {file.name for file in (files.root / "over").iterdir()} == {"0", "all"}


def test_whoever_wakes_after_its_lease_cannot_commit(files):
    (sleeper,) = _all(_claims(files, ["a"]))
    other = _claims(files, ["a"], seed=1)
    assert other.take() is None, "its holder is heard of"
    _silent_for(files, "0/a.1", 2 * LEASE)
    taken = _claims(files, ["a"], seed=2).take()
    assert (taken.number, taken.decided) == (2, False)
    assert not sleeper.renew()
    assert not sleeper.commit()
    assert taken.renew()
    assert taken.commit()
    assert was_committed(files.root, "a", 2)
    assert not was_committed(files.root, "a", 1)


def test_a_holder_that_commits_in_time_is_not_taken_over(files):
    (holder,) = _all(_claims(files, ["a"]))
    assert holder.commit()
    _silent_for(files, "0/a.2", 2 * LEASE)
    found = _claims(files, ["a"], seed=1).take()
    assert (found.number, found.decided) == (1, True), "what it staged is to be put in place"
    assert found.commit()
    found.finish()
    assert _claims(files, ["a"], seed=2).take() is None


def test_a_lease_is_judged_by_the_file_systems_clock_alone(files):
    """A process whose own clock stands still takes over, and one whose clock runs does not."""
    _all(_claims(files, ["a"]))
    assert _claims(files, ["a"], clock=lambda: 1e9).take() is None
    _silent_for(files, "0/a.1", 2 * LEASE)
    assert _claims(files, ["a"], clock=lambda: 0.0).take().number == 2


def test_a_claim_that_is_kept_alive_is_young(files):
    (claim,) = _all(_claims(files, ["a"], lease=0.4))
    _silent_for(files, "0/a.1", 60.0)
    with held(claim, 0.4):
        deadline = time.monotonic() + 30.0
        while files.age("0/a.1") > 30.0:
            assert time.monotonic() < deadline
            time.sleep(0.01)


def test_a_scheduler_seizes_a_unit_whoever_holds_it(files):
    claims = _claims(files, ["a"])
    first, second = claims.seize("a"), claims.seize("a")
    assert (first.number, second.number) == (1, 2)
    assert not first.commit()
    assert second.commit()
    again = claims.seize("a")
    assert (again.number, again.decided) == (2, True)


def test_a_unit_that_nobody_finishes_is_given_up(files):
    for number in range(MOST_NUMBER):
        claim = _claims(files, ["a"], seed=number).take()
        assert claim.number == number + 1
        _silent_for(files, f"0/a.{claim.number}", 2 * LEASE)
    with pytest.raises(ClaimError, match="never finished; see what its workers said"):
        _claims(files, ["a"]).take()


def test_where_the_folder_is_gone_all_is_over(files):
    claims = _claims(files)
    claim = claims.take()
    shutil.rmtree(files.root)
    for asked in (claims.take, claim.renew, claim.commit, claim.finish):
        with pytest.raises(Gone):
            asked()


def test_many_threads_do_every_unit_once(files):
    """Over several blocks, with holders that are taken over while they work."""
    units, done = [f"unit-{n}" for n in range(2 * BLOCK + 10)], Counter()
    lock = threading.Lock()

    def work(seed):
        claims, waits = _claims(files, units, seed, lease=0.5), pauses(0.05, random.Random(seed))
        rng = random.Random(seed)
        while not claims.done:
            claim = claims.take()
            if claim is None:
                time.sleep(next(waits))
                continue
            if rng.random() < 0.05:
                continue  # as a process that was killed does
            if claim.commit():
                with lock:
                    done[claim.unit] += not claim.decided
                claim.finish()

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert done == Counter(units)


def test_pauses_grow_to_a_part_of_the_lease():
    made = list(islice(pauses(32.0, random.Random(0)), 8))
    assert made[0] <= 1.25 < made[1] < made[2]
    assert max(made) <= 8.0 * 1.25
    assert max(islice(pauses(1.0, random.Random(0)), 8)) <= 0.25 * 1.25
