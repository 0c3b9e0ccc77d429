"""Bad input ends a command with one clear line and exit code 2."""

from __future__ import annotations

import sys
from collections.abc import Callable

from integ_gym.evidence.command_line import sentence

INTERRUPTED = 130


def report_errors(command: str, run: Callable[[], int]) -> int:
    """Run a command; print what the user can mend as one line on standard error.

    Errors that are not about the input are raised with their traceback.
    """
    try:
        return run()
    except KeyboardInterrupt:
        print(f"integ-gym {command}: interrupted; what was finished stays", file=sys.stderr)
        return INTERRUPTED
    except (ValueError, TypeError, OSError, ModuleNotFoundError, RuntimeError) as error:
        if not _is_meant_for_users(error):
            raise
        print(f"integ-gym {command}: {sentence(error)}", file=sys.stderr)
        return 2


def _is_meant_for_users(error: Exception) -> bool:
    """Whether the error was raised by this package's own checks."""
    if isinstance(error, OSError):
        return True
    traceback = error.__traceback__
    while traceback is not None and traceback.tb_next is not None:
        traceback = traceback.tb_next
    raised_in = traceback.tb_frame.f_globals.get("__name__", "") if traceback else ""
    return str(raised_in).startswith("integ_gym.")
