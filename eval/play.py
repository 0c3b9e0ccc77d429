"""A plant driven by hand, whose discretization is changed while it moves."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Mapping
from itertools import zip_longest
from time import perf_counter
from typing import Any

import numpy as np

from integ_gym.envs.engines.stepping import integrators_of
from integ_gym.envs.environment import IntegEnv, environment_class
from integ_gym.envs.registries import TRUTH
from integ_gym.envs.rendering.canvas import load_pygame, open_screen
from integ_gym.envs.rendering.cockpit import SHOWN, Choice, Cockpit, Course, Moment, View
from integ_gym.envs.settings import NATIVE, Setup
from integ_gym.envs.transition import LOSSES, control_columns
from integ_gym.support.errors import InputError

STEPS = (4.0, 2.0, 1.0, 0.5, 0.25, 0.125)
"""Steps to choose from, in units of the first one, as far as the arguments allow them."""
LEAST_PERIOD = 0.5
"""Shortest time that the hand's control is held, in units of the first step."""
_DAY = 86_400.0
_AMOUNTS = ("motor", "numerics", "losses", "energy")


class Game:
    """One plant in one discretization at a time.

    A change of integrator or step keeps the state of the plant and the ledger of its energy:
    start + motor + numerics − losses = energy, whatever was chosen when.

    Args:
        env_id: one of integ-gym's environments, or of one's own as ``"module:Id-v0"``.
        arguments: of its constructor.
        seed: of the first start.

    Attributes:
        push: of the hand, from −1 to 1 of the control's limit.
        lift: of the other hand, where the plant's `hands` say what the two do to its controls.
        time: since the start, s.
        ended: why it does not go on; empty while it does.

    Raises:
        TypeError, ValueError: for an environment or arguments that cannot be.
    """

    def __init__(self, env_id: str, arguments: Mapping[str, Any], seed: int) -> None:
        if "control_period" in arguments:
            raise InputError(
                "`control_period` follows the step during play: it is dt, or half of the "
                "first dt where that is longer; leave it out"
            )
        if "mixture" in arguments:
            raise InputError(
                "who plays chooses the integrator and the step, so nothing is drawn from a "
                "`mixture`; leave it out"
            )
        self._class = environment_class(env_id)
        task = self._class.task_class()
        start = "hanging" if "hanging" in task.starts else task.starts[0]  # leaves most to do
        self._arguments = {"duration": _DAY, "start": start, **arguments}
        if task.discrete is not None:
            self._arguments.setdefault("fallback", "zero")  # a hand that rests gives no action
        first = self._class(**self._arguments).setup.settings
        names = (*integrators_of(first.engine), *([TRUTH] if first.engine == NATIVE else []))
        own = () if first.integrator in names else (first.integrator,)
        self.integrators: tuple[str, ...] = (*own, *names)
        self._integrator, self._first, self._seed = first.integrator, first.dt, seed
        self._dt = first.dt
        self.steps = tuple(filter(self._is_possible, (first.dt * n for n in STEPS)))
        self.restart()

    @property
    def setup(self) -> Setup:
        """Of the environment as it is now."""
        return self._env.setup

    @property
    def period(self) -> float:
        """How long the hand's control is held, s: the step, or half of the first one."""
        return self.setup.timing.control_period

    def restart(self) -> None:
        """Begin again from another start, in the same discretization."""
        self.push, self.lift, self.time, self.ended = 0.0, 0.0, 0.0, ""
        self._env = self._build(self._dt)
        self._info = self._env.reset(seed=self._seed)[1]
        self._seed += 1
        self._marks: list[float] = []
        self._times = [0.0]
        self._amounts = {name: [0.0] for name in _AMOUNTS}
        self._amounts["energy"] = [self._info["energy"]]

    def choose_integrator(self, place: int) -> None:
        """Go on with another of :attr:`integrators`; nothing where there is none at the place."""
        if place < len(self.integrators):
            self._change(self.integrators[place], self._dt)

    def turn_integrator(self, by: int) -> None:
        """Go on with one of the next or, where negative, of the integrators before."""
        place = self.integrators.index(self._integrator) + by
        self.choose_integrator(place % len(self.integrators))

    def refine(self, by: int) -> None:
        """Go on with a finer or, where negative, with a coarser of :attr:`steps`."""
        place = self.steps.index(self._dt) + by
        self._change(self._integrator, self.steps[min(len(self.steps) - 1, max(0, place))])

    def advance(self) -> None:
        """Let one :attr:`period` pass, unless the game has ended."""
        if self.ended:
            return
        _, _, terminated, truncated, info = self._env.step(self._action())
        self._info = info
        self.time += self.period
        self._times.append(self.time)
        for name, gained in (
            ("motor", info["actuator_work"]),
            ("numerics", info["energy_residual"]),
            ("losses", -sum(info[name] for name in LOSSES)),
        ):
            self._amounts[name].append(self._amounts[name][-1] + gained)
        self._amounts["energy"].append(info["energy"])
        if terminated:
            blown = info["solver_status"] == "diverged"
            ended = "the goal is reached" if info["success"] else "the task is lost"
            self.ended = "the numbers blew up" if blown else ended
        elif truncated:
            self.ended = "a day is over"

    def ledger(self) -> dict[str, float]:
        """Amounts of energy so far, J: what motor, numerics and losses gave, and what there is."""
        return {name: amounts[-1] for name, amounts in self._amounts.items()}

    def view(self) -> View:
        """What there is to see."""
        settings = self.setup.settings
        engine = "" if settings.engine == NATIVE else f"{settings.engine} "
        step = "solved to rounding" if self._integrator == TRUTH else f"dt {self._dt:g} s"
        status = self._info["solver_status"]
        warning = f"{self.ended}: R begins again" if self.ended else ""
        if not self.ended and status not in ("ok", "not_reported"):
            warning = f"the solver says: {status.replace('_', ' ')}"
        names = [f"{place}  {_words(name)}" for place, name in enumerate(self.integrators, 1)]
        since = bisect_left(self._times, self.time - SHOWN)
        amounts = {name: self._amounts[name][since:] for name in ("motor", "numerics", "energy")}
        return View(
            f"{engine}{_words(self._integrator)}, {step}",
            warning,
            self.time,
            Moment(np.array(self._env.state_components), self._controls(), self.ledger()),
            (
                Choice("integrator", names, self.integrators.index(self._integrator)),
                Choice("step", [f"{step:g} s" for step in self.steps], self.steps.index(self._dt)),
            ),
            Course(self._times[since:], amounts, self._marks, self.setup.energy_at_goal or None),
        )

    def _controls(self) -> tuple[float, ...]:
        names = [name for _, name in control_columns(self.setup.plant)]
        return tuple(0.0 if self.ended else float(self._info[name]) for name in names)

    def _action(self) -> Any:
        choices = self.setup.task.discrete
        if choices is None:
            limits = self.setup.task.control_limits
            first, other = getattr(self.setup.plant, "hands", ((1.0,) * len(limits), ()))
            shares = [
                self.push * x + self.lift * y for x, y in zip_longest(first, other, fillvalue=0)
            ]
            pairs = zip(limits, shares, strict=True)
            return [0.5 * (high + low + (high - low) * share) for (low, high), share in pairs]
        return math.nan if not self.push else (choices - 1 if self.push > 0.0 else 0)

    def _change(self, integrator: str, dt: float) -> None:
        if (integrator, dt) == (self._integrator, self._dt):
            return
        state = self._env.state
        self._integrator, self._dt = integrator, dt
        self._env = self._build(self._dt)
        self._info = self._env.reset(options={"state": state})[1]
        self._marks.append(self.time)

    def _build(self, dt: float) -> IntegEnv:
        period = max(dt, LEAST_PERIOD * self._first)
        parts = {"integrator": self._integrator, "dt": dt, "control_period": period}
        return self._class(**{**self._arguments, **parts})

    def _is_possible(self, dt: float) -> bool:
        """Whether the arguments, such as a latency, go together with a step."""
        try:
            self._build(dt)
        except ValueError:
            return False
        return True


def _words(integrator: str) -> str:
    return integrator.rpartition(":")[2].replace("_", " ")


AMOUNTS_HELP = (
    "motor: what you gave.  numerics: what the integrator's error gave (above 0) or took.  "
    "energy: the sum, with what there was at the start."
)


def list_keys(plant: Any) -> str:
    """The keys that do something on a plant."""
    second = "W, S: lift      " if len(getattr(plant, "hands", ())) > 1 else ""
    return (
        f"Left, Right: push      {second}Up, Down: coarser, finer step      "
        "1 to 9, Tab: integrator      Space: pause      R: again      Esc: leave"
    )


_FRAMES = 60
_LARGEST_LAG = 0.25
"""A game further behind than this goes on from where it is, s."""


def play_in_window(game: Game) -> None:
    """Let somebody play until the window is closed, or Escape or Q is pressed.

    Raises:
        ValueError: where there is no display, with the remedy.
    """
    pygame = load_pygame()
    window = Window(game)
    try:
        while window.frame():
            pygame.time.wait(1000 // _FRAMES)
    finally:
        window.close()


class Window:
    """One game on the screen.

    Args:
        game: what is played.
        clock: time in s, from anywhere.

    Raises:
        ValueError: where there is no display, with the remedy.
    """

    def __init__(self, game: Game, clock: Callable[[], float] = perf_counter) -> None:
        self._pygame = load_pygame()
        self._game, self._clock = game, clock
        self._cockpit = Cockpit(game.setup, (list_keys(game.setup.plant), AMOUNTS_HELP))
        pygame = self._pygame
        self._hands = (pygame.K_LEFT, pygame.K_RIGHT, pygame.K_w, pygame.K_s)
        self._held: list[int] = []
        self._paused = False
        self._last = clock()
        self._due = 0.0
        picture = self._cockpit.frame(game.view())
        try:
            self._screen = open_screen(picture.get_size(), "integ-gym play")
        except ValueError as error:
            raise InputError(f"{error}; play on a machine with a display") from None

    def frame(self) -> bool:
        """Heed keys, let the time pass that has passed, draw; whether the game goes on."""
        for event in self._pygame.event.get():
            if not self._heeds(event):
                return False
        now = self._clock()
        self._due = min(_LARGEST_LAG, self._due + now - self._last)
        self._last = now
        if self._paused:
            self._due = 0.0
        while self._due >= self._game.period - 1e-9:
            self._due -= self._game.period
            self._game.advance()
        self._screen.blit(self._cockpit.frame(self._game.view()), (0, 0))
        self._pygame.display.flip()
        return True

    def close(self) -> None:
        """Close the window."""
        self._pygame.display.quit()

    def _heeds(self, event: Any) -> bool:
        """Do what an event asks for; whether the game goes on after it."""
        pygame, game = self._pygame, self._game
        if event.type == pygame.QUIT:
            return False
        if event.type == pygame.KEYUP and event.key in self._held:
            self._held.remove(event.key)
        if event.type == pygame.KEYDOWN:
            key = event.key
            if key in (pygame.K_ESCAPE, pygame.K_q):
                return False
            if key in self._hands and key not in self._held:
                self._held.append(key)
            if key == pygame.K_TAB:
                game.turn_integrator(-1 if getattr(event, "mod", 0) & pygame.KMOD_SHIFT else 1)
            if key in (pygame.K_UP, pygame.K_DOWN):
                game.refine(1 if key == pygame.K_DOWN else -1)
            if key == pygame.K_r:
                game.restart()
            if key == pygame.K_SPACE:
                self._paused = not self._paused
            if pygame.K_1 <= key <= pygame.K_9:
                game.choose_integrator(key - pygame.K_1)
        turns = game.setup.plant.controls[0][0] == "torque"
        game.push = self._held_direction(pygame.K_LEFT, pygame.K_RIGHT) * (-1.0 if turns else 1.0)
        game.lift = self._held_direction(pygame.K_s, pygame.K_w)
        return True

    def _held_direction(self, less: int, more: int) -> float:
        """−1 or 1, of the key of two that went down last; left turns counter-clockwise."""
        pressed = [key for key in self._held if key in (less, more)]
        return 0.0 if not pressed else 1.0 if pressed[-1] == more else -1.0
