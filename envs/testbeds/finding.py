"""The testbed of an environment id."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from integ_gym.support import Registry

from ..catalogue import ENVIRONMENTS
from .integ_environments import IntegTestbed
from .interface import Testbed
from .mujoco_tasks import MujocoTestbed

_OWN = Registry("integ_gym.envs.testbeds", "testbed", "make")


def testbed_of(env_id: str, arguments: Mapping[str, Any]) -> Testbed:
    """The testbed of an environment id; the same object for the same arguments.

    Args:
        env_id: of one of integ-gym's environments or of a MuJoCo task of Gymnasium's; or
            ``"module:Class"``, a testbed of a user's own.
        arguments: that all discretizations have in common, JSON-serialisable.

    Raises:
        ValueError: for a reference that cannot be loaded. An id that is unknown is refused, with
            what is possible, by what first makes its environment.
    """
    return _found(env_id, json.dumps(dict(arguments), sort_keys=True))


@lru_cache(maxsize=64)
def _found(env_id: str, arguments: str) -> Testbed:
    given = json.loads(arguments)
    if ":" in env_id:
        made: Testbed = _OWN.load(env_id)(**given)
        return made
    if env_id in ENVIRONMENTS:
        return IntegTestbed(env_id, **given)
    return MujocoTestbed(env_id, **given)
