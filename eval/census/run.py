"""The whole census."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from typing import Any

from integ_gym.envs.engines.maps import map_names, one_step_map
from integ_gym.envs.engines.stepping import integrators_of, missing_modules
from integ_gym.envs.registries import TRUTH
from integ_gym.support.errors import describe_exception
from integ_gym.support.optional import install_command, installed_versions

from .measuring import Line, measure
from .subjects import COAST, PUBLISHED, Subject, engine_subjects, installed

SCHEMA_VERSION = 1
PACKAGES = ("integ-gym", "numpy", "gymnasium", "jax", "mujoco", "mujoco-mjx", "warp-lang")
"""Packages whose version is recorded beside those of the lines."""


@dataclass
class Census:
    """What was found.

    Attributes:
        lines: one for each environment, and for each integrator of an engine and plant.
        missing: source to the command that installs it.
        failed: source to why it could not be looked at.
    """

    lines: list[Line] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)

    def to_json(self, command: str) -> dict[str, Any]:
        """Content of ``census.json``."""
        return {
            "schema_version": SCHEMA_VERSION,
            "command": command,
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
            "versions": installed_versions(PACKAGES),
            "free_motion_seconds": COAST,
            "maps": {name: _about(name) for name in (*map_names(), TRUTH)},
            "lines": [line.to_json() for line in self.lines],
            "missing": self.missing,
            "failed": self.failed,
        }


def take_census(
    libraries: Sequence[str], engines: Sequence[str], tell: Callable[[str], None]
) -> Census:
    """Look at everything of some libraries and engines that is installed.

    What a library or engine raises is noted, and the others are looked at.

    Args:
        libraries: registered names, or ``"module:Class"`` of your own.
        engines: registered names.
        tell: called with a line before each source is looked at.

    Raises:
        ValueError: for an unknown name.
    """
    census = Census()
    for name in libraries:
        library = PUBLISHED.load(name)()
        if not installed(name):
            census.missing[library.title] = library.install
        else:
            tell(library.title)
            _look(census, library.title, library.subjects)
    for name in engines:
        if missing_modules(name):
            census.missing[name] = install_command(name)
        else:
            tell(name)
            _look(census, name, partial(engine_subjects, name, integrators_of(name)))
    return census


def _about(name: str) -> str:
    """The first sentence of a map's description."""
    return " ".join(str(one_step_map(name).__doc__).split("\n\n")[0].split())


def _look(census: Census, source: str, subjects: Callable[[], Iterator[Subject]]) -> None:
    try:
        for subject in subjects():
            census.lines.append(measure(subject))
            del subject  # before the next one is made
    except Exception as error:  # whatever the code of others does
        census.failed[source] = describe_exception(error)
