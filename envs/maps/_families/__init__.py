"""Families that maps are made of: Runge-Kutta tableaux, linearly implicit kicks."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .linearly_implicit import LinearlyImplicit, damping_slopes
    from .runge_kutta import ExplicitRungeKutta, ImplicitRungeKutta, Tableau, along_row
else:
    __getattr__, __dir__ = lazy_door(__name__)
