"""Items made in a thread beside their use."""

from __future__ import annotations

import multiprocessing
import subprocess
import sys
import threading

import pytest

from integ_gym.support import processes as threads
from integ_gym.support.processes import prefetch

PATIENCE = 60.0
"""Until a thread that should have come is given up, s."""


def test_items_come_in_their_order():
    assert list(prefetch(iter(range(5)))) == [0, 1, 2, 3, 4]
    assert list(prefetch(iter([]))) == []
    assert list(prefetch(iter([None, None]))) == [None, None]


def test_the_next_item_is_made_while_one_is_used():
    made = [threading.Event() for _ in range(3)]

    def items():
        for number, event in enumerate(made):
            event.set()
            yield number

    for number in prefetch(items()):
        assert made[min(number + 1, 2)].wait(PATIENCE)


def test_what_making_raises_is_raised_in_its_place():
    def items():
        yield 1
        raise ValueError("no second")

    following = prefetch(items())
    assert next(following) == 1
    with pytest.raises(ValueError, match="no second"):
        next(following)


def test_no_item_is_lost_where_threads_end_in_between():
    """The main thread ends while another goes on: the second item can be given to no thread."""
    program = """
import threading
from integ_gym.support.processes import prefetch

def use():
    following = prefetch(iter(range(4)))
    found = [next(following)]
    ended.wait()
    print(found + list(following))

ended = threading.Event()
threading.Thread(target=use).start()
threading._register_atexit(ended.set)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == ("[0, 1, 2, 3]\n", "")


@pytest.mark.parametrize("parent", [None, multiprocessing.current_process()])
def test_a_worker_has_one_thread(parent, monkeypatch):
    monkeypatch.setattr(threads, "parent_process", lambda: parent)
    made = []

    def items():
        for _ in range(3):
            made.append(threading.get_ident())
            yield None

    assert list(prefetch(items())) == [None] * 3
    assert {ident == threading.get_ident() for ident in made} == {parent is not None}
