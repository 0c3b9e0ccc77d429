"""The window on this machine's screen."""

from __future__ import annotations

import os
from typing import Any

from .canvas import load_pygame

_UNSEEN = ("dummy", "offscreen")
"""Drivers of SDL that show nothing; it takes one where there is no screen."""


def open_screen(size: tuple[int, int], caption: str) -> Any:
    """Open the window, or give it another size.

    Args:
        size: (width, height), pixels.
        caption: what stands above it.

    Returns:
        Its surface.

    Raises:
        ValueError: where there is no screen, but for a driver that ``SDL_VIDEODRIVER`` names.
    """
    pygame = load_pygame()
    display = pygame.display
    try:
        display.init()
        if display.get_driver() in _UNSEEN and "SDL_VIDEODRIVER" not in os.environ:
            display.quit()
            raise pygame.error("there is no screen")
        surface = display.set_mode(size)
    except pygame.error as error:
        raise ValueError(f"no window can be opened ({error})") from None
    display.set_caption(caption)
    return surface
