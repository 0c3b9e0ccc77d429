"""A mixture of discretizations as pure functions: lanes grouped by integrator."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np

from ...arithmetic.jax_ops import jax, jnp
from ...arithmetic.ops import Component, Components
from ...catalogue.lookup import environment_mixture
from ...episode.control_period import EnvState, Outcome
from ...episode.mixture import WEIGHT
from .environment import FunctionalEnv
from .params import Params

_DRAWN = ("dt", "substeps", "sensor")
"""Entries of :class:`Params` that the members of a group differ in."""


class MixtureParams(NamedTuple):
    """What may differ between mixtures that share one program."""

    groups: tuple[tuple[Params, ...], ...]
    """By group and member."""
    bounds: tuple[tuple[Component, ...], ...]
    """By group: where in [0, 1) one member's part ends and the next one's begins."""


@dataclass(frozen=True)
class _Group:
    """Members that one compiled function can advance: in general those of one integrator.

    Attributes:
        env: that of the first member.
        members: their places in the mixture.
        params: of each member.
        shares: of each member in the whole mixture.
    """

    env: FunctionalEnv
    members: tuple[int, ...]
    params: tuple[Params, ...]
    shares: tuple[Fraction, ...]

    @property
    def share(self) -> Fraction:
        """Of the group in the mixture."""
        return sum(self.shares, Fraction(0))

    @property
    def bounds(self) -> tuple[float, ...]:
        """Where one member's part of the group ends and the next one's begins."""
        *bounds, total = accumulate(self.shares)
        return tuple(float(bound / total) for bound in bounds)


class FunctionalMixture(FunctionalEnv):
    """A functional environment whose lanes run on the members of a mixture.

    Lanes are grouped by integrator, so that each is advanced by its own alone: the last axis of a
    batch is cut into parts, one per integrator (beside it, arguments that need another program of
    their own), in the order in which the mixture names them. A part is as large as its members'
    shares, so that every integrator has its share of the lanes at every moment, exactly and not
    only in expectation. Within its part, every lane draws a member, which means a step ``dt``, by
    the shares at every reset.

    Which lanes make up a part never changes. Dealing the integrators out anew among the lanes that
    are reset together would give episodes of the same distribution, as lanes differ in nothing but
    their number. It is a stratified draw: where episodes end early, integrators with short episodes
    have more episodes than their share, where independent draws (those of ``gym.make_vec``) would
    give them fewer decisions.

    Args:
        env_id: a registered id.
        mixture: discretizations (dicts of ``integrator``, ``dt`` and, optionally, ``weight``).
        dtype: float type of the physics.
        arguments: the other constructor arguments.
    """

    def __init__(
        self,
        env_id: str,
        mixture: Sequence[Mapping[str, Any]],
        *,
        dtype: str = "float32",
        **arguments: Any,
    ) -> None:
        drawn = environment_mixture(env_id, {**arguments, "mixture": mixture})
        self._given = {**arguments, "mixture": mixture}
        self._groups = _grouped(env_id, dtype, self._given, drawn.shares)
        super().__init__(env_id, dtype=dtype, **_member_arguments(arguments, mixture[0]))
        self.setups, self.shares = drawn.setups, drawn.shares
        self.start_size += 1
        self.structure = _structure_of(self._groups)

    def params(self, **arguments: Any) -> Any:
        """Values of other constructor arguments for the same program.

        Args:
            arguments: replace those that the environment was made with, ``mixture`` included.

        Raises:
            TypeError: for an unknown argument.
            ValueError: for an impossible value, or one that needs another program.
        """
        groups = self._groups
        if arguments:
            given = {**self._given, **arguments}
            shares = environment_mixture(self.env_id, given).shares
            groups = _grouped(self.env_id, self._dtype, given, shares)
            self._check_structure(_structure_of(groups))
        return MixtureParams(
            tuple(group.params for group in groups), tuple(group.bounds for group in groups)
        )

    def columns(self, params: Sequence[MixtureParams]) -> MixtureParams:
        """As that of a single discretization, for every member."""
        single = super().columns
        groups = zip(*(one.groups for one in params), strict=True)
        return MixtureParams(
            tuple(tuple(map(single, zip(*alike, strict=True))) for alike in groups),
            jax.tree.map(lambda *x: np.array(x)[:, None], *(one.bounds for one in params)),
        )

    def check_lanes(self, count: int) -> None:
        """Check that every group can have its share of so many lanes.

        Raises:
            ValueError: if a share is no whole number of lanes, with the numbers that would do.
        """
        unit = math.lcm(*(group.share.denominator for group in self._groups))
        if count % unit or not count:
            names = (f"{g.env.setup.settings.integrator} {g.share}" for g in self._groups)
            parts = ", ".join(names)
            raise ValueError(
                f"{count} environments cannot be shared out among the integrators of the mixture "
                f"({parts}); their number (`n_envs`) must be a multiple of {unit}"
            )

    def lane_params(self, params: Any, member: Components) -> tuple[Params, ...]:
        """By group, the values that hold in each of its lanes.

        Args:
            params: see :meth:`params`.
            member: (the member of every lane,), shape (…, lanes).

        Raises:
            ValueError: if the lanes cannot be shared out; see :meth:`check_lanes`.
        """
        (members,) = member
        parts = zip(self._groups, params.groups, self._parts(members), strict=True)
        return tuple(_chosen(options, group.members, part) for group, options, part in parts)

    def fresh(self, drawn: Components, params: Any) -> tuple[EnvState, Components]:
        """Episodes that start anew: the last number draws the member of each lane's group."""
        *numbers, last = drawn
        parts = zip(self._groups, params.bounds, self._parts(last), strict=True)
        drawn_by = [_member(part, group.members, bounds) for group, bounds, part in parts]
        member = jnp.concatenate(drawn_by, axis=-1)
        own = self.lane_params(params, (member,))
        return self.begin(self.start(tuple(numbers), own), own), (member,)

    def common(self, params: Any) -> Params:
        """Those of the first group: all but the discretization is common to the members."""
        first: Params = params[0]
        return first

    def advance(self, env: EnvState, control: Component, params: Any) -> tuple[EnvState, Outcome]:
        """One control period, each part of the lanes by its group's integrator alone.

        Args:
            env: components of shape (…, lanes).
            control: torque, force or action index, of that shape.
            params: see :meth:`lane_params`.
        """
        count = env.q[0].shape[-1]
        advanced = [
            group.env.advance(*_of_lanes((env, control, own), lanes, count))
            for group, own, lanes in zip(self._groups, params, self._slices(count), strict=True)
        ]
        return jax.tree.map(lambda *parts: jnp.concatenate(parts, axis=-1), *advanced)  # type: ignore[no-any-return]

    def _slices(self, count: int) -> list[slice]:
        """The part of ``count`` lanes that each group has."""
        self.check_lanes(count)
        ends = accumulate((int(group.share * count) for group in self._groups), initial=0)
        return [slice(*ends) for ends in pairwise(ends)]

    def _parts(self, values: Component) -> list[Component]:
        """Values of shape (…, lanes), by group."""
        if jnp.ndim(values) == 0:
            raise ValueError("a mixture needs a batch of environments; give lanes=(n,)")
        return [values[..., lanes] for lanes in self._slices(values.shape[-1])]


def make(
    env_id: str,
    *,
    dtype: str = "float32",
    mixture: Sequence[Mapping[str, Any]] | None = None,
    **arguments: Any,
) -> FunctionalEnv:
    """The functional form of an environment.

    Args:
        env_id: a registered id.
        dtype: float type of the physics, ``"float32"`` or ``"float64"``; observations are float32.
        mixture: as for ``gym.make_vec``; see
            :class:`integ_gym.envs.environments.functional.mixture.FunctionalMixture` for what is
            drawn when.
        arguments: those of ``gym.make``, but for ``render_mode``.

    Raises:
        TypeError: for an unknown argument.
        ValueError: for an impossible value, an engine outside JAX or its own stops, or float64
            outside JAX's 64-bit mode.
        ModuleNotFoundError: without JAX, with the command that installs it.
    """
    if mixture is None:
        return FunctionalEnv(env_id, dtype=dtype, **arguments)
    return FunctionalMixture(env_id, mixture, dtype=dtype, **arguments)


def _grouped(
    env_id: str, dtype: str, arguments: Mapping[str, Any], shares: Sequence[Fraction]
) -> tuple[_Group, ...]:
    """Members that share a program, by the order of their first."""
    envs = [
        FunctionalEnv(env_id, dtype=dtype, **_member_arguments(arguments, member))
        for member in arguments["mixture"]
    ]
    places: dict[Hashable, list[int]] = {}
    for place, env in enumerate(envs):
        places.setdefault(env.structure, []).append(place)
    return tuple(
        _Group(
            envs[members[0]],
            tuple(members),
            tuple(envs[k].params() for k in members),
            tuple(shares[k] for k in members),
        )
        for members in places.values()
    )


def _member_arguments(arguments: Mapping[str, Any], member: Mapping[str, Any]) -> dict[str, Any]:
    """Constructor arguments of one member's own environment."""
    return {k: x for k, x in {**arguments, **member}.items() if k not in ("mixture", WEIGHT)}


def _structure_of(groups: Sequence[_Group]) -> Hashable:
    return tuple((group.env.structure, group.members, group.share) for group in groups)


def _member(number: Component, members: Sequence[int], bounds: Sequence[Component]) -> Component:
    """The member that each number from [0, 1) stands for, int32."""
    member = jnp.full(number.shape, members[0], jnp.int32)
    for index, bound in zip(members[1:], bounds, strict=True):
        member = jnp.where(number >= bound, index, member)
    return member


def _chosen(options: Sequence[Params], members: Sequence[int], drawn: Component) -> Params:
    """One group's values, those of the member that each lane has drawn."""
    chosen = options[0]
    for index, other in zip(members[1:], options[1:], strict=True):
        here = drawn == index
        values: dict[str, Any] = {
            name: jnp.where(here, getattr(other, name), getattr(chosen, name))
            for name in _DRAWN
            if getattr(chosen, name) is not None
        }
        chosen = chosen._replace(**values)
    return chosen


def _of_lanes(tree: Any, lanes: slice, count: int) -> Any:
    """Entries that have one value for each of ``count`` lanes, for some of them."""

    def part(value: Any) -> Any:
        varied = jnp.ndim(value) > 0 and value.shape[-1] == count
        return value[..., lanes] if varied else value

    return jax.tree.map(part, tree)
