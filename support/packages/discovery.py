"""Registries made of the modules in a folder: adding a file adds the thing it defines."""

from __future__ import annotations

import hashlib
import importlib
import inspect
import pkgutil
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from ..parameters import unknown_name


def raised_here(error: BaseException) -> bool:
    """Whether an error was raised by this package's own code, and not by what it calls."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    return bool(frames) and str(frames[-1].f_globals.get("__name__", "")).startswith("integ_gym.")


def describe_exception(error: BaseException) -> str:
    """Kind and message on one line; of an error without a message, the line that raised it."""
    kind, words = type(error).__name__, " ".join(str(error).split()).rstrip(".")
    frames = traceback.extract_tb(error.__traceback__)
    if words or not frames:
        return f"{kind}: {words}" if words else kind
    return f"{kind} in `{frames[-1].line}` ({Path(frames[-1].filename).name})"


@contextmanager
def translate_errors(what: str) -> Iterator[None]:
    """Raise whatever the code of others raises as a `ValueError` of one sentence.

    Args:
        what: could not be done, in words, before what the error says.

    Raises:
        ValueError: in place of an exception that another's code raised.
    """
    try:
        yield
    except Exception as error:  # whatever the code of others raises
        if raised_here(error):
            raise
        raise ValueError(f"{what}: {describe_exception(error)}") from error


class Registry:
    """Names of the modules in a package, each of which defines one class of a kind.

    Args:
        package: the package whose modules are listed; `interface` and names that begin with an
            underscore are left out.
        kind: what the classes are, for messages.
        method: a method that the class of each module has.
    """

    def __init__(self, package: str, kind: str, method: str) -> None:
        self._package = package
        self._kind = kind
        self._method = method

    def names(self) -> tuple[str, ...]:
        """Registered names, sorted."""
        return _modules(self._package)

    def load(self, name: str) -> type[Any]:
        """The class of that name, or of a reference ``"module:Class"`` to a user's own.

        Raises:
            ValueError: for a name that is neither, with the valid choices.
        """
        if ":" in name:
            return self._load_reference(name)
        if name not in self.names():
            own = f', or "module:Class" for {self._article()} of your own'
            raise ValueError(unknown_name(self._kind, name, self.names()) + own)
        module = importlib.import_module(f"{self._package}.{name}")
        return self._only_class(module)

    def source_hash(self, name: str) -> str | None:
        """SHA-256 of the source that defines a user's own class; None for a registered name.

        Raises:
            ValueError: for a name that is neither.
        """
        loaded = self.load(name)
        if ":" not in name:
            return None
        source = inspect.getsource(inspect.getmodule(loaded) or loaded)
        return hashlib.sha256(source.encode()).hexdigest()

    def at_work(self, error: BaseException, names: Iterable[str]) -> tuple[str, ...]:
        """Those of some names in whose class's methods an error was raised.

        Args:
            error: with its traceback.
            names: registered names or references.
        """
        frames = traceback.walk_tb(error.__traceback__)
        callers = {type(frame.f_locals.get("self")) for frame, _ in frames}
        return tuple(name for name in names if self.load(name) in callers)

    def _article(self) -> str:
        return f"{'an' if self._kind[0] in 'aeiou' else 'a'} {self._kind}"

    def _only_class(self, module: ModuleType) -> type[Any]:
        found = [
            value
            for value in (getattr(module, name) for name in _public(module))
            if isinstance(value, type)
            and f"{value.__module__}.".startswith(f"{module.__name__}.")
            and hasattr(value, self._method)
        ]
        if len(found) != 1:
            raise ValueError(
                f"{module.__name__} must define exactly one class with `{self._method}`, "
                f"found {[c.__name__ for c in found]}"
            )
        return found[0]

    def _load_reference(self, reference: str) -> type[Any]:
        module_name, _, class_name = reference.partition(":")
        try:
            loaded = getattr(importlib.import_module(module_name), class_name)
        except Exception as error:  # whatever the user's module does while it is imported
            raise ValueError(
                f"cannot load {self._kind} {reference!r}: {type(error).__name__}: {error}; "
                'write it as "module:Class", importable from here'
            ) from error
        if not isinstance(loaded, type) or not hasattr(loaded, self._method):
            raise ValueError(
                f"{reference!r} is not {self._article()}: it must be a class with a method "
                f"`{self._method}`"
            )
        return loaded


def _public(module: ModuleType) -> Iterable[str]:
    """What a module holds; of a package, what its door offers."""
    return getattr(module, "__all__", None) or tuple(vars(module))


@cache
def _modules(package: str) -> tuple[str, ...]:
    """Public modules in a package's folder, sorted."""
    path = importlib.import_module(package).__path__
    modules = (m.name for m in pkgutil.iter_modules(path))
    return tuple(sorted(m for m in modules if m != "interface" and not m.startswith("_")))
