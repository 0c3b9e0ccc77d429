"""A film in a window, over and over in real time."""

from __future__ import annotations

from time import perf_counter

from integ_gym.envs.rendering.canvas import load_pygame, open_screen

from .film import Film

_PAUSE = 1.5
"""How long the last frame stays before the film begins again, s."""


def show_film(film: Film) -> None:
    """Show a film until its window is closed, or Escape or Q is pressed.

    Raises:
        ValueError: where there is no display, with the remedy.
    """
    pygame = load_pygame()
    frames = [pygame.surfarray.make_surface(frame.swapaxes(0, 1)) for frame in film]
    try:
        screen = open_screen(frames[0].get_size(), "integ-gym watch")
    except ValueError as error:
        raise ValueError(f"{error}; write the film with --out film.gif or film.mp4") from None
    began = perf_counter()
    while not _is_closed(pygame):
        passed = (perf_counter() - began) % (len(frames) / film.fps + _PAUSE)
        screen.blit(frames[min(len(frames) - 1, int(passed * film.fps))], (0, 0))
        pygame.display.flip()
        pygame.time.wait(1000 // (2 * film.fps))
    pygame.display.quit()


def _is_closed(pygame: object) -> bool:
    return any(
        event.type == pygame.QUIT  # type: ignore[attr-defined]
        or (event.type == pygame.KEYDOWN and event.key in (pygame.K_ESCAPE, pygame.K_q))  # type: ignore[attr-defined]
        for event in pygame.event.get()  # type: ignore[attr-defined]
    )
