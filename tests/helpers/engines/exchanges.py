"""What a process of another environment was asked and what it answered: recorded, and replayed.

A recording is a file of JSON lines: the name of a process, then its calls and answers in turn.
Replayed, a process of this Python answers as the recorded one did, and refuses any other call.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

RECORDED = Path(__file__).parents[2] / "envs" / "recorded"
"""Folder of the recordings."""


@contextmanager
def recorded(name: str) -> Iterator[None]:
    """Real processes, whose exchange is written down."""
    from integ_gym.support.isolated import IsolatedEnvironment, Worker

    processes: list[list[str]] = []

    class Recorded(Worker):
        def __init__(self, *given: Any) -> None:
            super().__init__(*given)
            self._lines = [json.dumps({"process": self.name})]
            processes.append(self._lines)

        def _answer(self, method: str, text: str, patience: float) -> str:
            line = super()._answer(method, text, patience)
            self._lines += [text, line.strip()]
            return line

    with patch("integ_gym.support.isolated.Worker", Recorded):
        assert IsolatedEnvironment
        yield
    lines = [line for process in processes for line in process]
    (RECORDED / f"{name}.jsonl").write_text("\n".join(lines) + "\n", encoding="utf-8")


@contextmanager
def replayed(name: str) -> Iterator[None]:
    """Processes that answer as recorded."""
    from integ_gym.support.isolated import IsolatedEnvironment, Worker

    def start(apart: IsolatedEnvironment, served: Path) -> Worker:
        command = [sys.executable, "-I", __file__, str(RECORDED / f"{name}.jsonl")]
        return Worker(apart.name, command)

    with patch.object(IsolatedEnvironment, "start", start):
        yield


def record(name: str, scenario: Callable[[], Any]) -> Any:
    """What a scenario gives, its exchange written down."""
    with recorded(name):
        return scenario()


def answer(path: str) -> None:
    """Answer calls on standard input as recorded.

    What makes a scene anew leaves nothing of what went before, and so begins as a process does.
    """
    recorded: list[list[Any]] = [[]]
    for line in Path(path).read_text(encoding="utf-8").splitlines():
        said = json.loads(line)
        if "process" in said or _begins(said):
            recorded.append([])
        if "process" not in said:
            recorded[-1].append(said)
    possible, at = recorded, 0
    for line in sys.stdin:
        asked = json.loads(line)
        if _begins(asked):
            possible, at = recorded, 0
        possible = [one for one in possible if one[at : at + 1] == [asked]]
        unknown = {"error": f"not in the recording: {line.strip()[:200]}"}
        print(json.dumps(possible[0][at + 1] if possible else unknown), flush=True)
        at += 2


def _begins(said: dict[str, Any]) -> bool:
    return said.get("call") == "make" and "lanes" in said["given"]


if __name__ == "__main__":
    answer(sys.argv[1])
