"""Pickles of stable-baselines3, torch and NumPy, read without importing or calling what they name.

Names on a fixed list become `StandIn` objects, which keep what they are given; others are refused.
"""

from __future__ import annotations

import io
import math
import pickle
from collections.abc import Callable, Collection
from functools import cache
from typing import Any, ClassVar, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..policy import ObservationStatistics
from .card import PolicyFileError

Name: TypeAlias = tuple[str, str]
"""Module and name of what a pickle imports."""

_NUMPY = ("numpy._core", "numpy.core")
_NUMBERS = ("f4", "f8", "i4", "i8")

ARRAYS: frozenset[Name] = frozenset(
    {
        ("__builtin__", "bytes"),  # how protocol 2 writes none
        ("_codecs", "encode"),
        ("numpy", "dtype"),
        ("numpy", "ndarray"),
        *((f"{core}.multiarray", name) for core in _NUMPY for name in ("scalar", "_reconstruct")),
        *((f"{core}.numeric", "_frombuffer") for core in _NUMPY),
    }
)
"""What pickles of NumPy's arrays and numbers import."""

SPACES: frozenset[Name] = frozenset(
    {
        *(
            (f"{package}.spaces.{module}", name)
            for package in ("gym", "gymnasium")
            for module, name in (
                ("box", "Box"),
                ("dict", "Dict"),
                ("discrete", "Discrete"),
                ("multi_binary", "MultiBinary"),
                ("multi_discrete", "MultiDiscrete"),
                ("tuple", "Tuple"),
            )
        ),
        ("collections", "OrderedDict"),
        ("gym.utils.seeding", "RandomNumberGenerator"),
        ("numpy.random._mt19937", "MT19937"),
        ("numpy.random._pcg64", "PCG64"),
        *(
            ("numpy.random._pickle", f"__{name}_ctor")
            for name in ("bit_generator", "generator", "randomstate")
        ),
        ("numpy.random.bit_generator", "SeedSequence"),
        ("numpy.random.bit_generator", "__pyx_unpickle_SeedSequence"),
    }
)
"""What pickles of spaces import, with their random generators."""


class StandIn:
    """Stands in for an object of another package: keeps what it is made of, and runs nothing.

    Attributes:
        name: of its class, or of the function that makes it.
        arguments: that it is made with.
        state: that it is given then.
        entries: attributes or items by name.
    """

    name: ClassVar[Name]
    arguments: tuple[Any, ...]
    state: Any
    entries: dict[str | int, Any]

    def __new__(cls, *arguments: Any, **named: Any) -> Self:
        instance = super().__new__(cls)
        instance.arguments, instance.state, instance.entries = arguments, None, {}
        return instance

    def __setstate__(self, state: Any) -> None:
        self.state = state
        for part in state if isinstance(state, tuple) else (state,):
            if isinstance(part, dict):
                self.entries.update(part)

    def __setitem__(self, key: str | int, value: Any) -> None:
        self.entries[key] = value

    def extend(self, values: list[Any]) -> None:
        """Leave out the elements of a queue."""


_UNREAD = b"".join(
    (
        *(pickle.EXT1, pickle.EXT2, pickle.EXT4, pickle.INST, pickle.OBJ, pickle.DUP),
        *(pickle.DICT, pickle.EMPTY_SET, pickle.ADDITEMS, pickle.FROZENSET),
        *(pickle.PERSID, pickle.NEXT_BUFFER, pickle.READONLY_BUFFER),
    )
)
"""Opcodes that no file here needs."""


@cache
def _build_class(module: str, name: str) -> type[StandIn]:
    return type(name, (StandIn,), {"name": (module, name)})


class _Unpickler(pickle._Unpickler):
    """The reader that is written in Python, whose table of opcodes can be made shorter.

    Keys are texts or whole numbers: a hash of nested tuples can take for ever, or crash.
    """

    stack: list[Any]
    read: Callable[[int], bytes]
    dispatch: ClassVar[dict[int, Callable[[Any], None]]] = {
        opcode: load for opcode, load in pickle._Unpickler.dispatch.items() if opcode not in _UNREAD
    }

    def __init__(self, content: bytes, allowed: Collection[Name], storages: bool) -> None:
        super().__init__(io.BytesIO(content))
        self._allowed, self._storages = allowed, storages

    def find_class(self, module: str, name: str) -> type[StandIn]:
        if (module, name) not in self._allowed:
            raise PolicyFileError(
                f"imports {module}.{name} when it is loaded, which is not on the list of what such "
                "a file needs"
            )
        return _build_class(module, name)

    def persistent_load(self, pid: Any) -> Any:
        if not self._storages:
            raise PolicyFileError("refers to numbers that are stored elsewhere")
        return pid

    def _read_bytearray(self) -> None:
        """Without room for it before it is there."""
        content = self.read(int.from_bytes(self.read(8), "little"))
        self.stack.append(content)

    dispatch[pickle.SETITEM[0]] = lambda self: _set(self, self.stack[-2:-1], pickle.SETITEM)
    dispatch[pickle.SETITEMS[0]] = lambda self: _set(self, self.stack[::2], pickle.SETITEMS)
    dispatch[pickle.BYTEARRAY8[0]] = _read_bytearray


def _set(reader: Any, keys: list[Any], opcode: bytes) -> None:
    if not all(type(key) in (str, int) for key in keys):
        raise PolicyFileError("holds a dictionary whose keys are no texts or whole numbers")
    pickle._Unpickler.dispatch[opcode[0]](reader)


def looks_pickled(content: bytes) -> bool:
    """Whether bytes begin as a pickle of protocol 2 or above does."""
    return len(content) > 1 and content[0] == 0x80 and 2 <= content[1] <= 5


def read_pickle(content: bytes, allowed: Collection[Name], *, storages: bool = False) -> Any:
    """The object in a pickle: texts, numbers, lists, tuples, dictionaries, and `StandIn` objects.

    Args:
        content: the pickle.
        allowed: all that it may import.
        storages: whether it may refer to what torch stores beside it, as a tuple.

    Raises:
        PolicyFileError: for another import, or bytes that are no such pickle.
    """
    try:
        return _Unpickler(content, allowed, storages).load()
    except PolicyFileError:
        raise
    except Exception as error:  # damaged bytes can fail in any way
        raise PolicyFileError(f"is not a readable pickle ({type(error).__name__})") from error


def get_entries(value: Any) -> dict[Any, Any]:
    """A dictionary itself, or what a `StandIn` object holds; empty for anything else."""
    if isinstance(value, StandIn):
        return value.entries
    return value if isinstance(value, dict) else {}


def read_number_type(content: bytes) -> str | None:
    """Type of the numbers of one pickled array, such as `f4`; None for what is no such array."""
    try:
        return _get_number_type(_get_buffer(read_pickle(content, ARRAYS))[1])
    except Exception:  # damaged bytes can fail in any way
        return None


def to_array(held: Any) -> NDArray[np.float64]:
    """The values of an array or number of NumPy's.

    Raises:
        PolicyFileError: for anything else.
    """
    content, dtype, shape, order = _get_buffer(held)
    kind, byte_order = _get_number_type(dtype), dtype.state[1] if dtype.state else "<"
    if byte_order not in ("<", ">", "=") or order not in ("C", "F"):
        raise PolicyFileError("holds statistics that are no arrays of numbers")
    flat = np.frombuffer(_bytes(content), dtype=f"{byte_order}{kind}")
    return flat.reshape(shape, order=order).astype(np.float64)


def _get_buffer(held: Any) -> tuple[Any, Any, Any, Any]:
    """Bytes, type, shape and order of an array or number."""
    name = held.name[1] if isinstance(held, StandIn) else ""
    if name == "_reconstruct" and held.state is not None:
        _, shape, dtype, fortran, content = held.state
        return content, dtype, shape, "F" if fortran else "C"
    if name == "scalar":
        return held.arguments[1], held.arguments[0], (), "C"
    if name == "_frombuffer":
        content, dtype, shape, order = held.arguments
        return content, dtype, shape, order
    raise PolicyFileError("holds statistics that are no arrays of numbers")


def _get_number_type(dtype: Any) -> str:
    kind = dtype.arguments[0] if isinstance(dtype, StandIn) else None
    if kind not in _NUMBERS:
        raise PolicyFileError("holds statistics that are no arrays of numbers")
    return str(kind)


def _bytes(content: Any) -> bytes:
    """Bytes, which protocol 2 writes as text to be encoded."""
    if isinstance(content, StandIn) and content.name == ("_codecs", "encode"):
        text, encoding = content.arguments
        if isinstance(text, str) and encoding == "latin1":
            return text.encode("latin1")
    if not isinstance(content, bytes):
        raise PolicyFileError("holds statistics whose numbers are not stored as bytes")
    return content


_CLASS = ("stable_baselines3.common.vec_env.vec_normalize", "VecNormalize")
_RUNNING_MEAN = ("stable_baselines3.common.running_mean_std", "RunningMeanStd")
_ALLOWED = ARRAYS | SPACES | {_CLASS, _RUNNING_MEAN}


def read_vec_normalize(content: bytes) -> ObservationStatistics | None:
    """What a `VecNormalize` does to observations; None where it leaves them as they are.

    Args:
        content: of the file that ``VecNormalize.save(path)`` wrote.

    Raises:
        PolicyFileError: for another file, or values that cannot be.
    """
    saved = read_pickle(content, _ALLOWED)
    if not isinstance(saved, StandIn) or saved.name != _CLASS:
        raise PolicyFileError("holds no VecNormalize of stable-baselines3")
    held = saved.entries
    if held.get("norm_obs", True) is False:
        return None
    statistics = get_entries(held.get("obs_rms"))
    if not {"mean", "var"} <= statistics.keys():
        raise PolicyFileError(
            "holds no statistics of one vector of observations; those of a dictionary are not read"
        )
    return ObservationStatistics(
        to_array(statistics["mean"]),
        to_array(statistics["var"]),
        _number(held.get("epsilon")),
        _number(held.get("clip_obs")),
    )


def _number(given: Any) -> float:
    value = float(to_array(given).item()) if isinstance(given, StandIn) else given
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise PolicyFileError("holds no `epsilon` or `clip_obs` that is a number")
    return float(value)
