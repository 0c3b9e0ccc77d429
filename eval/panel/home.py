"""The home of a policy: what it was trained on, stated or unknown, never assumed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from integ_gym.envs.lanes import DiscretizedVectorEnv
from integ_gym.envs.settings import DISCRETIZATION, Discretization, Mixture
from integ_gym.envs.testbeds.making import find_testbed, make_training_environments
from integ_gym.envs.testbeds.mjcf import stock_arguments
from integ_gym.support.errors import InputError
from integ_gym.support.parameters import texts_of
from integ_gym.train.policy_files import sidecar
from integ_gym.train.policy_files.card import HASH_KEY

from .cells import UNNAMED, DiscretizationMixture, Home, main_home

VARIED = (*DISCRETIZATION, "mixture")

_OF_THE_EPISODE = ("duration", "start")
"""Arguments that a policy does not meet in a decision; an evaluation may choose them."""


@dataclass(frozen=True)
class Provenance:
    """What is known of a policy's training.

    Attributes:
        home: discretization or mixture that it was trained on; None: unknown.
        control_period: time between two of its decisions, s; of several, that of the discretization
            that most of the training ran on.
        environment: constructor arguments of the environment that it is judged in, without the
            discretization.
        origin: where this comes from, in words.
        trained_with: what its training states of these arguments.
        overridden: arguments of its training in place of which others were given.
    """

    home: Home | None
    control_period: float
    environment: Mapping[str, Any]
    origin: str
    trained_with: Mapping[str, Any] = field(default_factory=dict)
    overridden: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        """In one line."""
        period = f"control period {self.control_period:g} s"
        if self.home is None:
            return f"home: unknown ({self.origin}); judged at {period}"
        members = " and ".join(member.name for member in self.home.shares)
        alike = f"{members}, {period}" if self.home.control_period else _home_words(self.home)
        rest = "".join(f", {name}={value}" for name, value in self.trained_with.items())
        return f"home: {alike}{rest} ({self.origin})"


def card_arguments(card: Mapping[str, Any], env_id: str, own_code: bool) -> dict[str, Any]:
    """Environment arguments of the training, as a side-car tells them.

    Raises:
        ValueError: if it does not, or is of another environment, or names code that may not be
            run.
    """
    config = card.get("config")
    given = config.get("env_arguments") if isinstance(config, Mapping) else None
    if not isinstance(config, Mapping) or not isinstance(given, Mapping):
        raise InputError(
            "the policy's side-car does not say what it was trained on; restore the file that the "
            "trainer wrote, or move it away and state the home with --home"
        )
    if config.get("env_id") != env_id:
        raise InputError(
            f"the policy was trained on {config.get('env_id')}; evaluate it with --env "
            f"{config.get('env_id')}. To see whether {env_id} is the same task: integ-gym contract "
            f"{config.get('env_id')} {env_id}"
        )
    arguments = dict(given)
    foreign = [text for text in texts_of(arguments) if ":" in text]
    if foreign and not own_code:
        raise InputError(
            f"the policy's side-car names {foreign[0]!r}, whose code would be run; if it is yours, "
            "pass --own-code"
        )
    return arguments


def provenance(
    env_id: str,
    card: Mapping[str, Any] | None,
    stated: sidecar.Stated,
    given: Mapping[str, Any],
    own_code: bool = False,
) -> tuple[Provenance, DiscretizedVectorEnv]:
    """What is known of a policy's training, and one lane of its training environment, closed.

    Args:
        env_id: environment to evaluate in.
        card: content of its side-car, or None.
        stated: its home.
        given: environment arguments that override those of its training; not the discretization,
            which is what the evaluation varies.
        own_code: whether a class that the side-car names as ``"module:Class"`` may be loaded.

    Raises:
        ValueError: if side-car and statement contradict each other, see also
            :func:`stated_arguments` and :func:`card_arguments`; or if ``given`` holds what the
            evaluation varies.
        TypeError, ValueError: for a home that the environment cannot have.
    """
    for name in VARIED:
        if name in given:
            raise InputError(
                f"`{name}` is what the evaluation varies; leave it out of --env-arg, state the "
                "policy's home with --home and choose cells with --integrator and --dt"
            )
    stated_args = sidecar.stated_arguments(stated, env_id, given)
    arguments, origin = stated_args, _origin(stated, stated_args, env_id)
    known = "integrator" in stated_args
    if card is not None:
        arguments = card_arguments(card, env_id, own_code)
        if card.get("home", "said by `config`") is None:
            _check_same(stated_args, arguments)
            arguments |= stated_args
        else:
            unseen = ", of before they had a hash: an edit of it goes unseen"
            origin = f"the side-car beside the policy{'' if HASH_KEY in card else unseen}"
            known = True
    _check_period(env_id, arguments, given)
    environments = _make_closed(env_id, {**_with_step(arguments), **given})
    home = _home(environments.mixture) if known else None
    main = main_home(home)
    period = (environments.setups[0].timing if main is None else main).control_period
    if card is not None and home is not None and "integrator" not in stated_args:
        _check_period_of(stated, stated_args, home, origin)
    elif card is not None and home is not None:
        other = _home(_make_closed(env_id, {**stated_args, **given}).mixture)
        if other != home:
            raise InputError(
                f"--home says {_home_words(other)} and {origin} {_home_words(home)}; leave out "
                "--home"
            )
        _check_same(stated_args, _defaults(env_id, arguments) | arguments)
    trained_with = {name: x for name, x in arguments.items() if name not in VARIED}
    told_of = trained_with
    if (card is not None or stated == sidecar.STOCK) and set(given) - {
        *trained_with,
        *_OF_THE_EPISODE,
    }:
        without = stock_arguments(find_testbed(env_id, given)) if ":" in env_id else {}
        told_of = _defaults(env_id, {**without, **arguments}) | trained_with
    overridden = {n: x for n, x in told_of.items() if n in given and given[n] != x}
    environment = {**trained_with, **given}
    return Provenance(home, period, environment, origin, trained_with, overridden), environments


def _check_period_of(
    stated: sidecar.Stated, arguments: Mapping[str, Any], home: Home, origin: str
) -> None:
    """Refuse to state less than a side-car says, unless it is the same."""
    periods = {member.control_period for member in home.shares}
    said = arguments.get("control_period")
    if stated == sidecar.UNKNOWN or not all(said is None or math.isclose(said, p) for p in periods):
        says = "the home is unknown" if said is None else f"control period {said:g} s"
        raise InputError(
            f"--home says {says} and {origin} {_home_words(home)}; leave out --home, or write the "
            "side-car again"
        )


def _check_same(arguments: Mapping[str, Any], carried: Mapping[str, Any]) -> None:
    """Refuse a statement that contradicts what a side-car says of the same argument."""
    for name, value in arguments.items():
        if name not in ("engine", "integrator", "dt") and carried.get(name, value) != value:
            raise InputError(
                f"--home says {name}={value} and the side-car {name}={carried[name]}; leave out "
                "--home, or write the side-car again"
            )


def _check_period(env_id: str, arguments: Mapping[str, Any], given: Mapping[str, Any]) -> None:
    """Refuse an argument that changes the control period of a task which has one of its own.

    Raises:
        ValueError: naming it, with the statement of a home that has this period.
    """
    home = arguments.get("control_period")
    common = {n: x for n, x in {**arguments, **given}.items() if n not in VARIED}
    if home is None or not given:
        return
    period = find_testbed(env_id, common).control_period
    if period is None or math.isclose(period, home):
        return
    for name in given:
        others = {n: x for n, x in common.items() if n != name}
        without = find_testbed(env_id, others).control_period
        if without is not None and math.isclose(without, home):
            raise InputError(
                f"--env-arg {name}={given[name]} makes the control period {period:g} s, and the "
                f"home has {home:g} s; leave it out, or state the home that the policy was trained "
                f"on: --home integrator=…,dt=…,control_period={period:g}"
            )


def _home_words(home: Home) -> str:
    """A home in words, control period included."""
    return " and ".join(
        f"{member.name} with control period {member.control_period:g} s" for member in home.shares
    )


def _defaults(env_id: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """What else the policy met in its training, where that is recorded as a whole."""
    setup = _make_closed(env_id, _with_step(arguments)).setups[0]
    return {name: x for name, x in setup.arguments().items() if name not in _OF_THE_EPISODE}


def _origin(stated: sidecar.Stated, arguments: Mapping[str, Any], env_id: str) -> str:
    if stated == sidecar.STOCK:
        return "stated: the environment as its library makes it"
    if "integrator" in arguments:
        return "stated"
    return f"no side-car says it, and none was stated; {sidecar.how_to_state(env_id)}"


def _with_step(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """A control period alone is that of one step per decision; a mixture's members have theirs."""
    if "control_period" in arguments and not {"dt", "mixture"} & set(arguments):
        return {"dt": arguments["control_period"], **arguments}
    return dict(arguments)


def _make_closed(env_id: str, arguments: Mapping[str, Any]) -> DiscretizedVectorEnv:
    environments = make_training_environments(env_id, arguments, 1)
    environments.close()
    return environments


def _home(mixture: Mixture) -> Home:
    """What a training environment's episodes run on, a discretization named twice counted once."""
    weights: dict[Discretization, float] = {}
    for setup, share in zip(mixture.setups, mixture.shares, strict=True):
        member = Discretization.of(setup)
        weights[member] = weights.get(member, 0.0) + float(share)
    if len(weights) == 1:
        return next(iter(weights))
    return DiscretizationMixture(UNNAMED, tuple(weights.items()))
