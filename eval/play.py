"""A plant driven by hand, whose discretization is changed while it moves."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Mapping
from time import perf_counter
from typing import Any

from integ_gym.envs.catalogue.lookup import environment_class
from integ_gym.envs.engines.interface import integrators_of
from integ_gym.envs.environment import IntegEnv
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.registries import TRUTH
from integ_gym.envs.rendering.canvas import load_pygame, open_screen
from integ_gym.envs.rendering.cockpit import (
    SHOWN,
    Choice,
    Cockpit,
    Course,
    Moment,
    View,
)
from integ_gym.envs.settings import NATIVE, Setup
from integ_gym.envs.transition import LOSSES
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
        time: since the start, s.
        ended: why it does not go on; empty while it does.

    Raises:
        TypeError, ValueError: for an environment or arguments that cannot be.
    """

    def __init__(self, env_id: str, arguments: Mapping[str, Any], seed: int) -> None:
        if "control_period" in arguments:
            raise InputError(
                "`control_period` follows the step while somebody plays: it is dt, or half of the "
                "first dt where that is longer; leave it out"
            )
        self._class = environment_class(env_id)
        self._arguments = {"duration": _DAY, "start": _start(self._class), **arguments}
        if self._class.task_class().discrete is not None:
            self._arguments.setdefault("fallback", "zero")  # a hand that rests gives no action
        first = self._class(**self._arguments).setup.settings
        self.integrators = _integrators(first.engine, first.integrator)
        self._integrator, self._first, self._seed = first.integrator, first.dt, seed
        self._dt = first.dt
        self._env = self._made()
        self.steps = tuple(filter(self._possible, (first.dt * n for n in STEPS)))
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
        self.push, self.time, self.ended = 0.0, 0.0, ""
        self._env = self._made()
        self._told = self._env.reset(seed=self._seed)[1]
        self._seed += 1
        self._marks: list[float] = []
        self._times = [0.0]
        self._amounts = {name: [0.0] for name in _AMOUNTS}
        self._amounts["energy"] = [self._told["energy"]]

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
        _, _, terminated, truncated, told = self._env.step(self._action())
        self._told = told
        self.time += self.period
        gained = {
            "motor": told["actuator_work"],
            "numerics": told["energy_residual"],
            "losses": -sum(told[name] for name in LOSSES),
        }
        self._times.append(self.time)
        for name, amount in gained.items():
            self._amounts[name].append(self._amounts[name][-1] + amount)
        self._amounts["energy"].append(told["energy"])
        if terminated:
            blown = told["solver_status"] == "diverged"
            self.ended = "the numbers blew up" if blown else "the task is lost"
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
        control = 0.0 if self.ended else float(self._told["control"])
        return View(
            f"{engine}{_words(self._integrator)}, {step}",
            self._warning(),
            self.time,
            Moment(self._env.state, control, self.ledger()),
            self._choices(),
            self._course(),
        )

    def _choices(self) -> tuple[Choice, ...]:
        names = [f"{place}  {_words(name)}" for place, name in enumerate(self.integrators, 1)]
        steps = [f"{step:g} s" for step in self.steps]
        return (
            Choice("integrator", names, self.integrators.index(self._integrator)),
            Choice("step", steps, self.steps.index(self._dt)),
        )

    def _course(self) -> Course:
        """Of the time that is shown."""
        since = bisect_left(self._times, self.time - SHOWN)
        amounts = {name: self._amounts[name][since:] for name in ("motor", "numerics", "energy")}
        rest = (0.0,) * len(self.setup.plant.coordinates)
        goal = float(self.setup.plant.energy(SCALAR, rest, rest))
        return Course(self._times[since:], amounts, self._marks, goal or None)

    def _warning(self) -> str:
        if self.ended:
            return f"{self.ended}: R begins again"
        status = self._told["solver_status"]
        return (
            ""
            if status in ("ok", "not_reported")
            else f"the solver says: {status.replace('_', ' ')}"
        )

    def _action(self) -> Any:
        choices = self.setup.task.discrete
        if choices is None:
            return [self.push * float(self.setup.task.control_limit)]
        return math.nan if not self.push else (choices - 1 if self.push > 0.0 else 0)

    def _change(self, integrator: str, dt: float) -> None:
        if (integrator, dt) == (self._integrator, self._dt):
            return
        state = tuple(self._env.state)
        self._integrator, self._dt = integrator, dt
        self._env = self._made()
        self._told = self._env.reset(options={"state": state})[1]
        self._marks.append(self.time)

    def _made(self, dt: float | None = None) -> IntegEnv:
        step = self._dt if dt is None else dt
        chosen = {
            "integrator": self._integrator,
            "dt": step,
            "control_period": max(step, LEAST_PERIOD * self._first),
        }
        return self._class(**{**self._arguments, **chosen})

    def _possible(self, dt: float) -> bool:
        """Whether the arguments, such as a latency, go together with a step."""
        try:
            self._made(dt)
        except ValueError:
            return False
        return True


def _start(owner: type[IntegEnv]) -> str:
    """The start that leaves most to do: hanging, where there is such a one."""
    starts: tuple[str, ...] = owner.task_class().starts
    return "hanging" if "hanging" in starts else starts[0]


def _integrators(engine: str, first: str) -> tuple[str, ...]:
    """Those of an engine, ours with the exact one, and the first one if it is somebody's own."""
    names = (*integrators_of(engine), *([TRUTH] if engine == NATIVE else []))
    return names if first in names else (first, *names)


def _words(integrator: str) -> str:
    return integrator.rpartition(":")[2].replace("_", " ")


HELP = (
    "Left, Right: push      Up, Down: coarser, finer step      1 to 9, Tab: integrator      "
    "Space: pause      R: again      Esc: leave",
    "motor: what you gave.  numerics: what the integrator's error gave (above 0) or took.  "
    "energy: the sum, with what there was at the start.",
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
        self._cockpit = Cockpit(game.setup, HELP)
        self._held: list[int] = []
        self._paused = False
        self._last = clock()
        self._due = 0.0
        self._keys = self._bindings()
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
        pygame = self._pygame
        if event.type == pygame.QUIT:
            return False
        if event.type == pygame.KEYUP and event.key in self._held:
            self._held.remove(event.key)
        if event.type == pygame.KEYDOWN:
            if event.key in (pygame.K_ESCAPE, pygame.K_q):
                return False
            if event.key in (pygame.K_LEFT, pygame.K_RIGHT) and event.key not in self._held:
                self._held.append(event.key)
            self._press(event.key, bool(getattr(event, "mod", 0) & pygame.KMOD_SHIFT))
        self._game.push = self._push()
        return True

    def _press(self, key: int, shifted: bool) -> None:
        if key == self._pygame.K_TAB:
            self._game.turn_integrator(-1 if shifted else 1)
        elif key in self._keys:
            self._keys[key]()

    def _bindings(self) -> dict[int, Callable[[], None]]:
        """Keys to what each does once when it goes down."""
        pygame, game = self._pygame, self._game
        numbers = {
            getattr(pygame, f"K_{n}"): lambda place=n - 1: game.choose_integrator(place)
            for n in range(1, 10)
        }
        return {
            **numbers,
            pygame.K_UP: lambda: game.refine(-1),
            pygame.K_DOWN: lambda: game.refine(1),
            pygame.K_r: game.restart,
            pygame.K_SPACE: self._pause,
        }

    def _pause(self) -> None:
        self._paused = not self._paused

    def _push(self) -> float:
        """Of the arrow that went down last: left is counter-clockwise, of a cart to the left."""
        if not self._held:
            return 0.0
        left = self._held[-1] == self._pygame.K_LEFT
        turns = self._game.setup.plant.control_name == "torque"
        return 1.0 if left == turns else -1.0
