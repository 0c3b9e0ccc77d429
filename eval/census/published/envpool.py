"""EnvPool."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.pendulum import Pendulum

from ..subjects import (
    Episode,
    Observed,
    Policy,
    State,
    Statement,
    Subject,
    nearest_turn,
)
from .interface import Library, max_control, plant_of, statement_of

ENVIRONMENTS = 32
"""Episodes watched at once."""

STEPS: dict[Policy, int] = {"random": 50, "driven": 200, "zero": 1000}
"""Control periods that they are watched for at most."""

NAMESAKE = "episodes watched; parameters and step are Gymnasium's, which it ports"
COPY = "episodes watched; parameters and step are those of its copy of dm_control's model"


class EnvPool(Library):
    """Watches episodes: EnvPool sets no state."""

    title = "EnvPool"
    package = "envpool"
    modules = ("envpool", "mujoco")
    install = "pip install envpool mujoco"

    def subjects(self) -> Iterator[Subject]:
        """Ports of Gymnasium's classic control and of dm_control's suite."""
        ported: dict[str, Any] = {"width": 32, "note": NAMESAKE}
        watched = Observed(Watch("Pendulum-v1", _gymnasium_pendulum, 2.0))
        stated = Statement(0.05, max_speed=8.0)
        yield self.subject("Pendulum-v1", Pendulum(), stated, 2.0, watched, **ported)
        for name in ("CartPole-v1", "phys2d/CartPole-v1"):
            watched = Observed(Watch(name, _gymnasium_cart_pole, 10.0), has_zero=False)
            yield self.subject(name, CartPole(), Statement(0.02), 10.0, watched, **ported)
        for name, file, decode in (
            ("PendulumSwingup-v1", "pendulum.xml", _suite_pendulum),
            ("CartpoleBalance-v1", "cartpole.xml", _suite_cart_pole),
        ):
            model = _model(file)
            strongest, plant = max_control(model), plant_of(model)
            watched = Observed(Watch(name, decode, strongest))
            yield self.subject(name, plant, statement_of(model, 1), strongest, watched, note=COPY)


@dataclass(frozen=True)
class Watch:
    """Episodes of one environment.

    Attributes:
        name: of the environment.
        decode: observations of a batch to states.
        strongest: the control of the largest action.
    """

    name: str
    decode: Callable[[Any], list[State]]
    strongest: float

    def __call__(self, policy: Policy) -> list[Episode]:
        """Until they end, or for :data:`STEPS`."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of bounds beyond float32
            return self._episodes(policy)

    def _episodes(self, policy: Policy) -> list[Episode]:
        env = import_module("envpool").make_gymnasium(self.name, num_envs=ENVIRONMENTS, seed=7)
        space, rng = env.action_space, np.random.default_rng(7)
        episodes = [Episode([state], []) for state in self.decode(env.reset()[0])]
        running = np.full(ENVIRONMENTS, True)
        for _ in range(STEPS[policy]):
            actions, controls = self._chosen(space, _shares(policy, episodes, rng))
            observations, _, ended, cut, _ = env.step(actions)
            states = self.decode(observations)
            for k in np.flatnonzero(running):
                episodes[k].controls.append(float(controls[k]))
                episodes[k].states.append(_turned(states[k], episodes[k].states[-1]))
            running &= ~(ended | cut)
            if not running.any():
                break
        env.close()
        return episodes

    def _chosen(self, space: Any, shares: np.ndarray) -> tuple[Any, Any]:
        """Actions, and the controls that they are, for shares of the strongest control."""
        if space.shape == ():
            pushed_right = shares > 0.0
            return pushed_right.astype(space.dtype), np.where(pushed_right, 1, -1) * self.strongest
        actions = (shares * space.high).astype(space.dtype)
        return actions[:, None], actions * (self.strongest / space.high[0])


def _shares(policy: Policy, episodes: list[Episode], rng: np.random.Generator) -> np.ndarray:
    """Controls as shares of the strongest, one for each environment."""
    if policy == "random":
        return rng.uniform(-1.0, 1.0, len(episodes))
    if policy == "zero":
        return np.zeros(len(episodes))
    return np.array([math.copysign(1.0, e.states[-1][1][-1]) for e in episodes])


def _turned(state: State, before: State) -> State:
    """The state with its angle unwrapped."""
    (*places, angle), v = state
    return (*places, nearest_turn(angle, before[0][-1])), v


def _model(file: str) -> Any:
    """The model that EnvPool steps."""
    assets = Path(import_module("envpool_assets").__path__[0])
    path = assets / "mujoco" / "assets_dmc" / file
    return import_module("mujoco").MjModel.from_xml_path(str(path))


def _gymnasium_pendulum(seen: Any) -> list[State]:
    rows = np.asarray(seen, dtype=np.float64)
    return [((math.atan2(sine, cosine),), (speed,)) for cosine, sine, speed in rows.tolist()]


def _gymnasium_cart_pole(seen: Any) -> list[State]:
    rows = np.asarray(seen, dtype=np.float64)
    return [((x, angle), (speed, spin)) for x, speed, angle, spin in rows.tolist()]


def _suite_pendulum(seen: Any) -> list[State]:
    return _gymnasium_pendulum(np.concatenate([seen["orientation"], seen["velocity"]], axis=1))


def _suite_cart_pole(seen: Any) -> list[State]:
    rows = np.concatenate([seen["position"], seen["velocity"]], axis=1).tolist()
    return [((x, math.atan2(sine, cosine)), (speed, spin)) for x, cosine, sine, speed, spin in rows]
