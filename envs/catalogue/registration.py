"""The environment ids, and their registration with Gymnasium.

Importing the package imports this, so that it takes no more than Gymnasium itself does.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import gymnasium as gym

_ID = re.compile(r'^ENV_ID: Final = "(\w+)(-v\d+)"$', re.MULTILINE)


def _declared() -> dict[str, str]:
    """Ids that the modules beside this one declare, read without importing them."""
    found = {}
    for path in sorted(Path(__file__).parent.glob("*.py")):
        for stem, version in _ID.findall(path.read_text(encoding="utf-8")):
            found[stem + version] = f"{__package__}.{path.stem}:{stem}"
    return found


ENVIRONMENTS: Final = _declared()
"""Environment id to module and common stem of its `Env` and `VectorEnv` class."""


def register_environments() -> None:
    """Register every id once; a second call changes nothing."""
    for env_id, stem in ENVIRONMENTS.items():
        if env_id not in gym.registry:
            gym.register(env_id, entry_point=f"{stem}Env", vector_entry_point=f"{stem}VectorEnv")
