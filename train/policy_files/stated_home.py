"""The home of a policy as people state it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

from integ_gym.envs.catalogue.lookup import is_integ_environment
from integ_gym.envs.settings import DISCRETIZATION, Discretization
from integ_gym.envs.testbeds.making import testbed_of
from integ_gym.support.options import named_value
from integ_gym.support.parameters import unknown_name

STOCK = "stock"
"""What is stated of a policy that was trained on Gymnasium's own environment."""

UNKNOWN = "unknown"
"""What is stated of a policy of which nobody says more; the same as nothing."""

STOCK_ARGUMENTS: Mapping[str, Mapping[str, Any]] = {
    "IntegPendulum-v0": {"max_speed": 8.0},
    "IntegCartPole-v0": {},
}
"""What makes an environment Gymnasium's own at its default discretization."""

Stated: TypeAlias = str | Mapping[str, Any] | Discretization | None
"""A home as people state it: ``"integrator=…,dt=…,control_period=…"``, the same as a mapping or a
`Discretization`, ``"stock"`` or ``"unknown"``; a control period alone leaves the rest unknown."""

HOW_TO_STATE = "state it with --home integrator=…,dt=…,control_period=… or --home stock"


def stated_arguments(stated: Stated, env_id: str) -> dict[str, Any]:
    """A stated home as constructor arguments of the training environment.

    Raises:
        ValueError: for what is no home, in one sentence.
    """
    if stated is None or stated == UNKNOWN:
        return {}
    if stated == STOCK:
        if ":" in env_id or (is_integ_environment(env_id) and env_id not in STOCK_ARGUMENTS):
            raise ValueError(
                f"{env_id} is no environment of Gymnasium's, so --home stock says nothing; give "
                "--home integrator=…,dt=…,control_period=…"
            )
        return {**testbed_of(env_id, {}).home.arguments(), **STOCK_ARGUMENTS.get(env_id, {})}
    parts = _parts(stated)
    for name in parts:
        if name not in DISCRETIZATION:
            raise ValueError(unknown_name("part of a home", name, DISCRETIZATION))
    if set(parts) == {"control_period"}:
        return parts
    lacking = [name for name in ("integrator", "dt") if name not in parts]
    if lacking:
        raise ValueError(
            f"the home lacks `{lacking[0]}`; give --home integrator=…,dt=…,control_period=…, or "
            "control_period=… alone where no more is known"
        )
    testbed = testbed_of(env_id, {})
    fixed = testbed.control_period
    period = parts["dt"] if fixed is None else fixed
    return {"engine": testbed.home.engine, "control_period": period, **parts}


def _parts(stated: str | Mapping[str, Any] | Discretization) -> dict[str, Any]:
    if isinstance(stated, Discretization):
        return stated.arguments()
    if isinstance(stated, Mapping):
        return dict(stated)
    words = [word.strip() for word in stated.split(",")]
    if not all("=" in word for word in words):
        raise ValueError(
            f"the home {stated!r} cannot be read; give integrator=…,dt=…,control_period=…, or "
            f"{STOCK!r} for what was trained on Gymnasium's own environment"
        )
    return dict(named_value(word) for word in words)
