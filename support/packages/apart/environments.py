"""Environments of their own: where their interpreter is, and what is said where it is not."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType

from .worker import Worker

CLONE = Path(__file__).resolve().parents[3]
"""Folder that the environments are set up in: the repository's, in a clone of it."""

SERVING = Path(__file__).with_name("serving.py")


@dataclass(frozen=True)
class Apart:
    """A Python environment of its own, that ``make NAME`` sets up in the folder ``.NAME``.

    Attributes:
        name: its name, and that of the distribution that it is for.
    """

    name: str

    @property
    def variable(self) -> str:
        """Environment variable that names another interpreter."""
        return f"INTEG_GYM_{self.name.upper()}_PYTHON"

    @property
    def command(self) -> str:
        """What sets it up."""
        return f"make {self.name}"

    @property
    def python(self) -> Path:
        """Its interpreter, whether it is there or not."""
        return Path(os.environ.get(self.variable) or CLONE / f".{self.name}" / "bin" / "python")

    @property
    def installed(self) -> bool:
        """Whether it is there."""
        return self.python.is_file()

    def version(self) -> str | None:
        """Version of the distribution that it is for; None where it is not set up."""
        return _version(self.python, self.name) if self.installed else None

    def start(self, served: Path) -> Worker:
        """A process that serves a file of ours with its interpreter.

        Args:
            served: file that defines a class ``Served``, whose methods can be called.

        Raises:
            ModuleNotFoundError: where the environment is not set up, with what does it.
        """
        if not self.installed:
            raise ModuleNotFoundError(
                f"{self.name} has an environment of its own, and {self.python} is not there; run: "
                f"{self.command} (in a clone of integ-gym), or name its interpreter in the "
                f"environment variable {self.variable}",
                name=self.name,
            )
        return Worker(self.name, [str(self.python), "-I", str(SERVING), str(served)])


APART: Mapping[str, Apart] = MappingProxyType(
    {name: Apart(name) for name in ("isaaclab", "dm_control")}
)
"""Distribution to the environment of its own."""


@cache
def _version(python: Path, package: str) -> str | None:
    ask = f"from importlib.metadata import version; print(version({package!r}))"
    done = subprocess.run(
        [str(python), "-I", "-c", ask], capture_output=True, text=True, check=False
    )
    return done.stdout.strip() or None
