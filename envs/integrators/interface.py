"""What an integrator is given and what it returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from ..mechanics import Kink, Rates, Slopes
from ..ops.ops import Component, Components, Ops

State = tuple[Components, Components]
"""Configuration and velocity."""


class System(Protocol):
    """The continuous-time system as an integrator sees it, at a constant control."""

    steep: bool
    """Whether a force may change within a small fraction of a step."""
    kinked: bool
    """Whether the accelerations have kinks where one of :meth:`kinks` is 0; smooth elsewhere."""

    def rates(self, ops: Ops, q: Components, v: Components, control: Components) -> Rates:
        """Accelerations, and the rates of the loss components (power lost, W)."""

    def slopes(self, ops: Ops, q: Components, v: Components, control: Components) -> Slopes | None:
        """(∂a/∂q, ∂a/∂v) as nested tuples, or None if the plant gives no Jacobian."""

    def kinks(self, ops: Ops, q: Components, v: Components, control: Component) -> tuple[Kink, ...]:
        """What is zero where there is a kink, with its rate; of a system that has some."""

    def limit(self, ops: Ops, v: Components) -> Components:
        """Velocities within the plant's speed limit."""


class Step(NamedTuple):
    """State after one step, with the solver's report."""

    q: Components
    v: Components
    """Before any speed limit; the engine applies the limit and books what it takes out."""
    losses: Components
    """Energy lost so far per loss component, J."""
    iterations: Component = 0
    residual: Component = 0.0
    """Largest scaled residual of the solver (dimensionless); 0 for explicit methods."""
    converged: Component = True
    push: Component = 0.0
    """Generalized force of an engine's own stop, N or N m, mean over the step."""


class Integrator(Protocol):
    """A one-step map of a second-order system over ``dt`` seconds.

    A class of your own needs this method and nothing else; the attributes ``order``,
    ``symplectic``, ``reversible``, ``solver_tolerance`` and ``solver_cap`` are read where present,
    and ``theory``, a :class:`LinearTheory`, of the class itself.
    Of a map that another engine applies, ``losses_of`` and ``losses_between`` are, too: what it
    loses when its end is known.
    """

    def step(
        self,
        ops: Ops,
        system: System,
        q: Components,
        v: Components,
        losses: Components,
        control: Components,
        dt: Component,
    ) -> Step:
        """Advance (q, v, losses) by ``dt`` under a constant control."""


UNLIMITED = float("inf")
"""Where there is no limit of stability."""


@dataclass(frozen=True)
class LinearTheory:
    r"""What theory says of an integrator on linear problems.

    On the oscillator :math:`\ddot x = -\omega^2 x` one step of size h depends on
    :math:`z = h\omega` alone, on the decay :math:`\dot v = -\lambda v` on :math:`z = h\lambda`.
    Sources: Hairer, Lubich and Wanner, *Geometric Numerical Integration*, 2nd ed., I.1 and I.5.2;
    Hairer and Wanner, *Solving Ordinary Differential Equations II*, 2nd ed., IV.2 and IV.3.

    Attributes:
        formula: the energy factor less 1, in words.
        oscillation_limit: largest z = hω at which no oscillation grows.
        decay_limit: largest z = hλ at which a damped velocity does not grow.
        energy_factor: factor on the oscillator's energy per step in the long run, of z = hω.
        passive: whether a step takes energy out of every convex potential.
    """

    formula: str
    oscillation_limit: float
    decay_limit: float
    energy_factor: Callable[[float], float] = lambda z: 1.0
    passive: bool = False
