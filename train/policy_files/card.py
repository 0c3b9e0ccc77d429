"""How large a policy file may be, and what is wrong with one, in one sentence."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.vector import VectorEnv

from integ_gym.envs.settings import DISCRETIZATION, STEPPING, Mixture, Setup
from integ_gym.support.errors import IntegGymError
from integ_gym.support.optional import installed_versions
from integ_gym.support.processes import host
from integ_gym.support.terminal import fixed

if TYPE_CHECKING:
    from ..config import TrainingConfig


RETRAIN = "train with PPO('MlpPolicy', ...) and save again"


DAMAGED = "save it again with model.save(path)"


class PolicyFileError(IntegGymError, ValueError):
    """A policy file, or a statistics file, that cannot be read safely; one sentence says why."""


MAX_WEIGHTS_BYTES = 256 * 2**20
"""Largest `policy.pth` that is read, in bytes, also after unpacking (256 MiB)."""


MAX_JSON_BYTES = 16 * 2**20
"""Largest `data` member and largest statistics file that are read, in bytes (16 MiB)."""


HASH_KEY = "card_hash"

FORMAT = "integ-gym policy 2"
UNHASHED_FORMAT = "integ-gym policy 1"
"""Of side-cars from before they had a hash of themselves."""


def card_hash(card: Mapping[str, Any]) -> str:
    """SHA-256 (hex) of a card without its own hash: JSON with sorted keys and without spaces.

    Raises:
        ValueError: for what is no JSON.
    """
    content = json.loads(json.dumps({k: x for k, x in card.items() if k != HASH_KEY}))
    text = json.dumps(
        content, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False
    )
    return hashlib.sha256(text.encode()).hexdigest()


def hashed(card: Mapping[str, Any]) -> dict[str, Any]:
    """A card with its hash of itself."""
    return {**card, HASH_KEY: card_hash(card)}


def card_bytes(card: Mapping[str, Any]) -> bytes:
    """The content of a side-car's file.

    Raises:
        ValueError: for what is no JSON.
    """
    return (json.dumps(card, indent=2, allow_nan=False, ensure_ascii=False) + "\n").encode()


def check_own_hash(card: Mapping[str, Any], file: Path, remedy: str) -> None:
    """Refuse a card that was edited after it was written.

    Args:
        card: what ``file`` says; one of before there was such a hash passes without.
        file: for the message.
        remedy: what helps, as the end of a sentence.

    Raises:
        PolicyFileError: in one sentence.
    """
    if HASH_KEY not in card and card.get("format") != FORMAT:
        return
    if card.get(HASH_KEY) != card_hash(card):
        raise PolicyFileError(
            f"{file}: was edited after it was written, for its `{HASH_KEY}` does not fit what it "
            f"says; {remedy}"
        )


_PACKAGES = ("integ-gym", "gymnasium", "numpy", "stable-baselines3", "torch")
_OF_TRAINER = {"sb3": (), "fleet": ("jax", "jaxlib")}
"""Packages whose versions are recorded; both trainers write SB3's zip."""

_DRAWN = {
    "sb3": "each environment draws a member at every reset",
    "fleet": "each integrator has its share of the environments at every moment; each environment "
    "draws its step at every reset",
}
"""How each trainer draws from a mixture."""

LAST_EPISODES = 100
"""Episodes at the end of training that the card summarises."""


def mixture_of(vector_env: VectorEnv[Any, Any, Any]) -> Mixture:
    """What training environments run on; environments side by side are alike."""
    env: Any = vector_env.unwrapped
    return env.mixture if hasattr(env, "mixture") else Mixture((env.get_attr("setup")[0],))


def make_card(
    config: TrainingConfig,
    mixture: Mixture,
    trainer: str,
    seconds: float,
    last_episodes: Mapping[str, Any],
) -> dict[str, Any]:
    """What the side-car says.

    Args:
        config: the run.
        mixture: the discretizations of the training environment; one where it is no mixture.
        trainer: ``"sb3"`` or ``"fleet"``.
        seconds: wall time; for a fleet its chunk's, divided by the policies in it.
        last_episodes: see :func:`episode_summary`.
    """
    setup = mixture.setups[0]
    members = [
        {**_discretization(member), "share": float(share)}
        for member, share in zip(mixture.setups, mixture.shares, strict=True)
    ]
    mixed = config.env_arguments.get("mixture") is not None
    name = "mixture" if mixed else f"{setup.settings.integrator}-dt{setup.settings.dt:g}"
    own = DISCRETIZATION if mixture.several_periods else STEPPING
    derived = config.derived(mixture.mean_period)
    if mixture.several_periods and trainer == "fleet":
        derived["gamma"] = [config.discount(period) for period in mixture.periods]
    return {
        "policy_id": f"{config.algorithm.lower()}-{name}-seed{config.seed}",
        "algorithm": config.algorithm,
        "trainer": trainer,
        "env_id": config.env_id,
        "discretization": None if mixed else _discretization(setup),
        "mixture": members if mixed else None,
        "mixture_drawn": _DRAWN[trainer] if mixed else None,
        "env_arguments": {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in setup.arguments().items()
            if not (mixed and name in own)
        },
        "units": setup.units(),
        "seed": config.seed,
        "config": asdict(config),
        "derived": derived,
        "steps": config.rounded_steps,
        "wall_seconds": round(seconds, 3),
        "last_episodes": {**last_episodes, "exploring": True},
        "versions": installed_versions((*_PACKAGES, *_OF_TRAINER[trainer])),
        "platform": host(),
    }


def episode_summary(returns: Sequence[float], successes: Sequence[float]) -> dict[str, Any]:
    """Number, mean return and success rate of some episodes."""
    return {
        "episodes": len(returns),
        "return_mean": float(np.mean(returns)) if len(returns) else None,
        "success_rate": float(np.mean(successes)) if len(successes) else None,
    }


def format_episode_stats(episodes: Mapping[str, Any]) -> str:
    """Return and success in a few words."""
    if not episodes["episodes"]:
        return "no episode ended yet"
    success = episodes["success_rate"]
    words = f"return {fixed(episodes['return_mean'], 1)}"
    return words if success is None else f"{words}, success {fixed(success)}"


def _discretization(setup: Setup) -> dict[str, Any]:
    """Engine, integrator, step and control period in s."""
    return {
        "engine": setup.settings.engine,
        "engine_version": setup.engine.version,
        "integrator": setup.settings.integrator,
        "dt": setup.timing.dt,
        "control_period": setup.timing.control_period,
    }
