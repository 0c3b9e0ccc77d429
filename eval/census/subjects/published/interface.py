"""What is told of a library of environments."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any, ClassVar

from integ_gym.envs import numerics
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.interface import Plant
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.support.isolated import Apart
from integ_gym.support.optional import package_version

from ..settable import Settable
from ..subject import Access, Statement, Subject


class Library(ABC):
    """A library that publishes a pendulum or a cart-pole."""

    title: ClassVar[str]
    """Its name, as people write it."""
    package: ClassVar[str]
    """The distribution whose version is told."""
    modules: ClassVar[tuple[str, ...]]
    """What has to be importable."""
    apart: ClassVar[Apart | None] = None
    """The environment of its own that it runs in, if it has one."""
    install: ClassVar[str]
    """The command that makes it so."""

    @abstractmethod
    def subjects(self) -> Iterator[Subject]:
        """Its environments."""

    def subject(
        self,
        name: str,
        plant: Plant,
        stated: Statement,
        max_control: float,
        access: Access,
        **more: Any,
    ) -> Subject:
        """One of its environments; see :class:`Subject`."""
        told = package_version(self.package) if self.apart is None else self.apart.version()
        version = told or "unknown"
        return Subject(self.title, name, version, True, plant, stated, max_control, access, **more)

    def pendulum(
        self, name: str, parameters: Any, max_control: float, step: numerics.OneStep, note: str = ""
    ) -> Subject:
        """A pendulum in float32 whose parameters have Gymnasium's names."""
        plant = Pendulum(mass=parameters.m, length=parameters.l, gravity=parameters.g)
        stated = Statement(parameters.dt, max_speed=parameters.max_speed)
        return self.subject(name, plant, stated, max_control, Settable(step), width=32, note=note)

    def cart_pole(
        self, name: str, parameters: Any, step: numerics.OneStep, words: str = "", **more: Any
    ) -> Subject:
        """A cart-pole whose parameters have Gymnasium's names; Euler's if it names any method."""
        plant = CartPole(
            cart_mass=parameters.masscart,
            mass=parameters.masspole,
            length=parameters.length,
            gravity=parameters.gravity,
        )
        stated = Statement(parameters.tau, map="explicit_euler" if words else None, words=words)
        return self.subject(name, plant, stated, parameters.force_mag, Settable(step), **more)
