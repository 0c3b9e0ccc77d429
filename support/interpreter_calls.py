"""Do one call for another interpreter: `python -m integ_gym.support.interpreter_calls`.

What is called comes pickled on standard input; what it yields goes pickled to standard output. What
is printed goes to standard error.
"""

from __future__ import annotations

import os
import pickle
import sys
import threading
from collections.abc import Callable
from functools import partial
from multiprocessing import spawn
from typing import Any

from .errors import IntegGymError, describe_exception
from .interpreters import are_running, describe_versions
from .optional import not_installed
from .processes import end_with_parent, limit_threads, reported_by


def serve() -> None:
    """Do the call."""
    calls, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    asked = pickle.load(calls)
    threading.Thread(target=end_with_parent, args=(os.getppid(),), daemon=True).start()
    send = partial(_send, answers)
    try:
        _answer(asked, send)
    except Exception as error:
        send("error", explain(error, asked["packages"]))
    send("end", None)


def _send(answers: Any, kind: str, value: Any) -> None:
    pickle.dump((kind, value), answers)
    answers.flush()


def _answer(asked: dict[str, Any], send: Callable[[str, Any], None]) -> None:
    if not are_running(asked["packages"]):
        found = describe_versions(asked["packages"])
        raise IntegGymError(f"it has {found}, perhaps for what PYTHONPATH names; unset that")
    sys.path += [path for path in asked["paths"] if path not in sys.path]
    if asked["main"] is not None:
        spawn.prepare({"init_main_from_path": asked["main"]})
    if not not_installed(["threadpoolctl"]):
        limit_threads()
    function, given, named = pickle.loads(asked["task"])
    with reported_by(partial(send, "work")):
        for value in function(*given, **named):
            send("value", value)


def explain(error: Exception, packages: Any) -> str:
    """What an error says, with the remedy where the versions are its cause."""
    if isinstance(error, ModuleNotFoundError) and not isinstance(error, IntegGymError):
        return (
            f"{error.name} is not in this interpreter, which has what integ-gym needs for the cell "
            "and what the policy is pickled by; name it among `packages`, with its version"
        )
    if isinstance(error, AttributeError | ImportError) and not isinstance(error, IntegGymError):
        return (
            f"these versions lack what integ-gym asks of them ({error}); give newer versions, or "
            "leave the cell out"
        )
    if isinstance(error, IntegGymError | ValueError):
        return str(error)
    return describe_exception(error)


if __name__ == "__main__":
    serve()
