"""Libraries whose published environments the census measures."""

from __future__ import annotations

from importlib.util import find_spec

from integ_gym.support.registry import Registry

_PUBLISHED = "integ_gym.eval.census.subjects.published"

PUBLISHED = Registry(
    "published library",
    "subjects",
    {
        "dm_control": f"{_PUBLISHED}.dm_control:DmControl",
        "envpool": f"{_PUBLISHED}.envpool:EnvPool",
        "gymnasium": f"{_PUBLISHED}.gymnasium:Gymnasium",
        "gymnasium_phys2d": f"{_PUBLISHED}.gymnasium_phys2d:GymnasiumPhys2d",
        "gymnax": f"{_PUBLISHED}.gymnax:Gymnax",
        "isaaclab": f"{_PUBLISHED}.isaaclab:Isaaclab",
        "mujoco_playground": f"{_PUBLISHED}.mujoco_playground:MujocoPlayground",
    },
)
"""Library to what its environments are read with."""


def installed(name: str) -> bool:
    """Whether the modules that a library needs are found, and the environment of its own.

    Args:
        name: registered, or ``"module:Class"``.
    """
    library = PUBLISHED.load(name)
    apart = getattr(library, "apart", None)
    found = all(find_spec(module) is not None for module in library.modules)
    return found and (apart is None or bool(apart.installed))
