"""Registries: the names of parts, where their classes are, and parts that other packages add."""

from __future__ import annotations

import hashlib
import importlib
import inspect
from collections.abc import Mapping
from functools import cached_property
from typing import Any

from .errors import InputError
from .parameters import unknown_name


class Registry:
    """Parts of one kind, each a name and the class that it stands for.

    Args:
        kind: what the classes are, for messages.
        method: a method that every class of the kind has.
        parts: name to ``"module:Class"``.
        group: entry points of installed packages that add parts. They are looked up when a name is
            not among `parts`, or when all names are listed.
    """

    def __init__(self, kind: str, method: str, parts: Mapping[str, str], group: str = "") -> None:
        self._kind = kind
        self._method = method
        self._group = group
        self.parts = dict(parts)

    @cached_property
    def _added(self) -> dict[str, str]:
        from importlib.metadata import entry_points

        found = entry_points(group=self._group) if self._group else ()
        return {point.name: point.value for point in found if point.name not in self.parts}

    def __contains__(self, name: object) -> bool:
        return name in self.parts or name in self._added

    def names(self) -> tuple[str, ...]:
        """All names, sorted."""
        return tuple(sorted({*self.parts, *self._added}))

    def load(self, name: str) -> type[Any]:
        """The class of a name, or of a reference ``"module:Class"`` to a user's own.

        Raises:
            ValueError: for a name that is neither, with the valid choices; for a reference that
                cannot be imported or is no such class.
        """
        if ":" in name:
            return self._import(name)
        if name not in self:
            own = f', or "module:Class" for {self._article()} of your own'
            raise InputError(unknown_name(self._kind, name, self.names()) + own)
        return self._import(self.parts.get(name) or self._added[name])

    def source_hash(self, name: str) -> str | None:
        """SHA-256 of the source of a class, or None if this package defines it.

        Raises:
            ValueError: for a name that is neither registered nor a reference.
        """
        loaded = self.load(name)
        if loaded.__module__.startswith("integ_gym."):
            return None
        source = inspect.getsource(inspect.getmodule(loaded) or loaded)
        return hashlib.sha256(source.encode()).hexdigest()

    def _article(self) -> str:
        return f"{'an' if self._kind[0] in 'aeiou' else 'a'} {self._kind}"

    def _import(self, reference: str) -> type[Any]:
        module_name, _, class_name = reference.partition(":")
        try:
            loaded = getattr(importlib.import_module(module_name), class_name)
        except Exception as error:  # whatever the module does while it is imported
            if reference in self.parts.values():
                raise
            raise InputError(
                f"cannot load {self._kind} {reference!r}: {type(error).__name__}: {error}; "
                'write it as "module:Class", importable from here'
            ) from error
        if not isinstance(loaded, type) or not hasattr(loaded, self._method):
            raise InputError(
                f"{reference!r} is not {self._article()}: it must be a class with a method "
                f"`{self._method}`"
            )
        return loaded
