"""What to say where MuJoCo has no OpenGL context to draw in."""

from __future__ import annotations

_HEADLESS = ("egl", "osmesa")
"""Values of `MUJOCO_GL` that need no display."""


def is_of_opengl(error: Exception) -> bool:
    """Whether an error of a renderer is that there is no context to draw in."""
    words = f"{type(error).__module__} {type(error).__name__} {error}".lower()
    return any(word in words for word in ("opengl", "egl", "osmesa", "glfw", "x11", "display"))


def no_context(chosen: str | None) -> str:
    """The remedy.

    Args:
        chosen: the environment variable `MUJOCO_GL`.
    """
    failed = "MuJoCo has no OpenGL context to draw in"
    if chosen not in _HEADLESS:
        return (
            f"{failed}; without a display set the environment variable MUJOCO_GL=egl (or osmesa) "
            "before Python starts"
        )
    other = next(name for name in _HEADLESS if name != chosen)
    return (
        f"{failed} with MUJOCO_GL={chosen}; install its library (on Debian libegl1 or libosmesa6), "
        f"or set MUJOCO_GL={other} before Python starts"
    )
