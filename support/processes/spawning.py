"""Whether this program can start worker processes: asked before anything is created."""

from __future__ import annotations

import ast
import pickle
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

_ALONE = ", or ask for one worker (workers=1), which works in this process"


class SpawnError(RuntimeError):
    """Worker processes cannot be started from here; one sentence says why and what to do."""


def check_spawning(*sent: Any, alone: bool = False) -> None:
    """Check that a fresh process can import this program without running it, and take objects.

    Args:
        sent: what the processes will be given.
        alone: whether one worker would work in this process, which is then said as a remedy.

    Raises:
        SpawnError: in one sentence, if not.
    """
    otherwise = _ALONE if alone else ""
    main = sys.modules["__main__"]
    file = getattr(main, "__file__", None)
    if file is not None:
        path = Path(file)
        if not path.is_file():
            raise SpawnError(
                "a program read from standard input cannot start worker processes, which read it "
                f"again; save it as a file{otherwise}"
            )
        if path.suffix != ".pyc" and not _guarded(path):
            raise SpawnError(
                f"{path.name} starts worker processes, which import it, without "
                '`if __name__ == "__main__":`; put this call under it' + otherwise
            )
    for one in sent:
        _check_sent(one, file, otherwise)


def _check_sent(sent: Any, file: str | None, otherwise: str) -> None:
    try:
        text = pickle.dumps(sent)
    except Exception as error:  # pickling runs what an object says of itself
        raise SpawnError(
            f"worker processes cannot be given {_named(sent)} ({error}); define it at the top of a "
            f"module{otherwise}"
        ) from error
    if file is None and b"__main__" in text:
        raise SpawnError(
            f"worker processes cannot find {_named(sent)}, which was defined in a notebook or an "
            f"interactive session; define it in a module{otherwise}"
        )


def _named(sent: Any) -> str:
    name = getattr(sent, "policy_id", getattr(sent, "__name__", type(sent).__name__))
    return repr(name)


def _guarded(path: Path) -> bool:
    """Whether what runs now in the main program stands under the guard."""
    try:
        tree = ast.parse(path.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return True
    guards = [node for node in tree.body if isinstance(node, ast.If) and _is_guard(node.test)]
    line = next((f.f_lineno for f in _frames() if _is_main(f, path.name)), None)
    if line is None:
        return bool(guards)
    return any(node.lineno <= line <= (node.end_lineno or line) for node in guards)


def _is_guard(test: ast.expr) -> bool:
    names = {node.id for node in ast.walk(test) if isinstance(node, ast.Name)}
    texts = {node.value for node in ast.walk(test) if isinstance(node, ast.Constant)}
    return "__name__" in names and "__main__" in texts


def _is_main(frame: FrameType, file: str) -> bool:
    """Whether a frame is of the main program, and not of what forks processes for it."""
    own = frame.f_globals.get("__name__") == "__main__"
    code = frame.f_code
    return own and code.co_name == "<module>" and Path(code.co_filename).name == file


def _frames() -> Iterator[FrameType]:
    frame: FrameType | None = sys._getframe(1)
    while frame is not None:
        yield frame
        frame = frame.f_back
