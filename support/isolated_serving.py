"""Serve a file's class over standard input and output: a line of JSON for each call and answer.

Run by its path, by another interpreter than integ-gym's, of which it imports nothing:
``python -I isolated_serving.py FILE``. A call is ``{"call": NAME, "given": {…}}``, its answer
``{"value": …}``, or ``{"refused": WHY}`` for a ValueError and ``{"error": WHY}`` for others. What
the file or its libraries print goes to standard error.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
from typing import Any


def load_served(path: str) -> Any:
    """An object of the class ``Served`` that a file defines."""
    spec = importlib.util.spec_from_file_location("served", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["served"] = module
    spec.loader.exec_module(module)
    return module.Served()


def answer_to(served: Any, line: str) -> dict[str, Any]:
    """What one call gives."""
    try:
        asked = json.loads(line)
        return {"value": getattr(served, asked["call"])(**asked["given"])}
    except ValueError as error:
        return {"refused": str(error)}
    except Exception as error:  # whatever the library does
        return {"error": f"{type(error).__name__}: {error}"}


def serve(path: str) -> None:
    """Answer calls until there are no more."""
    calls, answers = os.fdopen(os.dup(0), encoding="utf-8"), os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    served = load_served(path)
    for line in calls:
        answers.write(json.dumps(answer_to(served, line)) + "\n")
        answers.flush()


if __name__ == "__main__":
    serve(sys.argv[1])
