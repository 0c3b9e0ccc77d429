"""A film of a policy: one start, several discretizations."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from integ_gym.envs.catalogue.lookup import environment_setup
from integ_gym.envs.registries import TRUTH
from integ_gym.envs.settings import Discretization
from integ_gym.support.optional import require
from integ_gym.train.policy import Policy
from integ_gym.train.policy_files.sidecar import read_trained, readable_file

from ..panel.existing.policy import read_existing
from .choosing import Asked, arguments_on, check_filmed, check_possible, chosen
from .episode import Episode, played
from .film import Film


def side_by_side(
    policy: Policy | str | os.PathLike[str],
    discretizations: Sequence[Asked],
    seed: int,
    *,
    env_id: str | None = None,
    environment: Mapping[str, Any] | None = None,
    own_code: bool = False,
) -> Film:
    """One policy from one start in several discretizations, as a film.

    >>> film = side_by_side("runs/rk4", ["rk4", "explicit_euler", "truth"], 0)  # doctest: +SKIP
    >>> film.write("film.gif")  # doctest: +SKIP

    Args:
        policy: what acts; or the folder or file of a trained one, whose side-car says what it was
            trained on.
        discretizations: from left to right: ``"rk4"`` (with the rest as the policy was trained, or
            as in ``environment``), ``"rk4 dt=0.01"``, ``"mujoco RK4"``, ``"truth"``, a
            :class:`Discretization`, or a mapping of some of its parts; none: the policy's home and
            the truth.
        seed: of the start, the same as that of ``reset``.
        env_id: one of integ-gym's environments; needed where no side-car says it.
        environment: constructor arguments that differ from those of the training.
        own_code: whether classes that the side-car names as ``"module:Class"`` may be loaded.

    Returns:
        The film: frames of shape (height, width, 3), drawn when asked for, ``success`` by
        discretization, and ``write``.

    Raises:
        PolicyFileError, ValueError, TypeError: for a policy or a discretization that cannot be.
        ModuleNotFoundError: if an extra is missing, with the command that installs it.
    """
    require("render")
    given = dict(environment or {})
    if isinstance(policy, (str, os.PathLike)):
        path = policy_path(Path(policy))
        if env_id is None:
            _, card = read_trained(path)
            env_id = str(card["config"]["env_id"])
        check_filmed(env_id)
        existing = read_existing(path, env_id, given, None, own_code)
        acting: Policy = existing.policy
        arguments, seed_of = dict(existing.provenance.environment), existing.seed
        arguments["control_period"] = existing.provenance.control_period
        homes = tuple(existing.home.shares) if existing.home is not None else ()
    else:
        if own_code:
            raise ValueError(
                "own_code lets a side-car name classes, and a policy that is no file has none; "
                "leave it out"
            )
        if env_id is None:
            raise ValueError("a policy alone does not say what it acts in; give env_id as well")
        check_filmed(env_id)
        acting, arguments, homes, seed_of = policy, given, (), None
    like = homes[0] if homes else Discretization.of(environment_setup(env_id, arguments))
    cells = [
        chosen(asked, like, env_id) for asked in discretizations or (*(homes or [like]), TRUTH)
    ]
    check_possible(cells, env_id, arguments)
    episodes = [played(acting, env_id, arguments_on(c, arguments), seed) for c in cells]
    return Film(episodes, homes, told(acting.policy_id, homes, seed_of, episodes, f"start {seed}"))


def policy_path(path: Path) -> Path:
    """The file of a policy that is given by it or by its folder."""
    return readable_file(path) if path.is_dir() else path


def told(
    name: str,
    homes: Sequence[Discretization],
    seed: int | None,
    episodes: Sequence[Episode],
    start: str,
) -> str:
    """What all episodes of a film have in common, in one line.

    Args:
        name: of the policy.
        homes: what it was trained on.
        seed: of its training.
        episodes: all of them.
        start: where they start, in words.
    """
    trained = " and ".join(home.name.replace("_", " ").replace("=", " ") for home in homes)
    by = [f"Trained on {trained} s" if homes else name]
    seeds = [f"seed {seed}"] if seed is not None else []
    setup = episodes[0].setup
    plant, limit = setup.plant, float(np.max(setup.task.control_limit))
    motor = f"{plant.control_name} within {limit:g} {plant.control_unit}"
    periods = {episode.discretization.control_period for episode in episodes}
    decision = [f"a decision every {period:g} s" for period in periods if len(periods) == 1]
    return ", ".join([*by, *seeds, motor, *decision, start])
