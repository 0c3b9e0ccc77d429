"""A pickle's content as inert data: names stay names, and what would be called is only noted."""

from __future__ import annotations

import pickletools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from ...error import PolicyFileError


@dataclass(frozen=True)
class Name:
    """What a pickle would import."""

    module: str
    name: str


@dataclass
class Note:
    """What a pickle would make: by whom, of what, and with which state."""

    maker: Any
    arguments: Any
    state: list[Any] = field(default_factory=list)


@dataclass
class _Pairs:
    """A dictionary, whose keys need not be hashable here."""

    pairs: list[tuple[Any, Any]] = field(default_factory=list)


class _Mark:
    pass


_MARK = _Mark()

Step: TypeAlias = Callable[["_Machine", Any], None]


def looks_pickled(content: bytes) -> bool:
    """Whether bytes begin as a pickle of protocol 2 or above does."""
    return len(content) > 1 and content[0] == 0x80 and 2 <= content[1] <= 5


def parse_pickle(content: bytes, storages: bool = False) -> Any:
    """The object in a pickle, as texts, numbers, lists, tuples, `Name` and `Note`; dictionaries are
    lists of pairs in a `Note` made by ``dict``.

    Args:
        content: the pickle.
        storages: whether it may say what torch keeps beside it, which becomes a `Note` too.

    Raises:
        PolicyFileError: for bytes that are no such pickle, or hold what is not read.
    """
    return _run(_Machine(), content, storages)


def names_in(content: bytes) -> list[Name]:
    """All that a pickle would import, torch's among them.

    Raises:
        PolicyFileError: for bytes that are no such pickle, or hold what is not read.
    """
    machine = _Machine()
    _run(machine, content, storages=True)
    return machine.names


def _run(machine: _Machine, content: bytes, storages: bool) -> Any:
    try:
        for opcode, argument, _ in pickletools.genops(content):
            if opcode.name == "STOP":
                return machine.stack.pop()
            step = _STEPS.get(opcode.name)
            if opcode.name == "BINPERSID" and storages:
                step = _Machine.storage
            if step is None:
                raise PolicyFileError(f"holds the pickle opcode {opcode.name}, which is not read")
            step(machine, argument)
    except PolicyFileError:
        raise
    except Exception as error:  # damaged bytes can fail in any way
        raise PolicyFileError(f"is not a readable pickle ({type(error).__name__})") from error
    raise PolicyFileError("is not a whole pickle")


def entries(note: Any) -> dict[str, Any]:
    """What an object's state or a dictionary holds under names that are texts."""
    states = note.state if isinstance(note, Note) else [note]
    pairs = [pair for one in states for pair in _pairs_of(one)]
    return {key: value for key, value in pairs if isinstance(key, str)}


def _pairs_of(state: Any) -> list[tuple[Any, Any]]:
    parts = state if isinstance(state, tuple) else (state,)  # (state, state of slots)
    return [pair for one in parts if isinstance(one, _Pairs) for pair in one.pairs]


class _Machine:
    def __init__(self) -> None:
        self.stack: list[Any] = []
        self.memo: dict[int, Any] = {}
        self.names: list[Name] = []

    def push(self, value: Any) -> None:
        self.stack.append(value)

    def pop(self) -> Any:
        return self.stack.pop()

    def drop(self) -> None:
        self.stack.pop()

    def to_mark(self) -> list[Any]:
        """What is above the last mark, which goes."""
        place = max(k for k, one in enumerate(self.stack) if one is _MARK)
        taken = self.stack[place + 1 :]
        del self.stack[place:]
        return taken

    def put(self, place: int | None) -> None:
        self.memo[len(self.memo) if place is None else place] = self.stack[-1]

    def name(self, argument: Any) -> None:
        if argument is None:
            name, module = self.pop(), self.pop()
        else:
            module, _, name = argument.partition(" ")
        self.names.append(Name(str(module), str(name)))
        self.push(self.names[-1])

    def storage(self, _: Any) -> None:
        self.push(Note(Name("torch", "storage"), self.pop()))

    def note(self, count: int = 2) -> None:
        """What would be made of the uppermost: maker, arguments, perhaps arguments by name."""
        taken = [self.pop() for _ in range(count)][::-1]
        self.push(Note(taken[0], tuple(taken[1:]) if count > 2 else taken[1]))

    def build(self) -> None:
        state = self.pop()
        target = self.stack[-1]
        if not isinstance(target, Note):
            raise PolicyFileError("sets the state of something that is no object")
        target.state.append(state)

    def tuple_of(self, count: int) -> None:
        taken = [self.pop() for _ in range(count)][::-1]
        self.push(tuple(taken))

    def append(self, values: list[Any]) -> None:
        target = self.stack[-1]
        (target if isinstance(target, list) else target.state).extend(values)

    def set_items(self, flat: list[Any]) -> None:
        target = self.stack[-1]
        pairs = list(zip(flat[::2], flat[1::2], strict=True))
        if isinstance(target, _Pairs):
            target.pairs.extend(pairs)
        else:
            target.state.append(_Pairs(pairs))


def _constant(value: Any) -> Step:
    return lambda machine, argument: machine.push(value)


def _given(machine: _Machine, argument: Any) -> None:
    machine.push(argument)


_STEPS: dict[str, Step] = {
    "PROTO": lambda machine, argument: None,
    "FRAME": lambda machine, argument: None,
    "MARK": _constant(_MARK),
    "NONE": _constant(None),
    "NEWTRUE": _constant(True),
    "NEWFALSE": _constant(False),
    **dict.fromkeys(
        (
            *("INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4"),
            *("FLOAT", "BINFLOAT", "STRING", "BINSTRING", "SHORT_BINSTRING"),
            *("BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "BYTEARRAY8"),
            *("UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8"),
        ),
        _given,
    ),
    **dict.fromkeys(
        ("PUT", "BINPUT", "LONG_BINPUT", "MEMOIZE"), lambda machine, place: machine.put(place)
    ),
    **dict.fromkeys(
        ("GET", "BINGET", "LONG_BINGET"), lambda machine, place: machine.push(machine.memo[place])
    ),
    "POP": lambda machine, argument: machine.drop(),
    "DUP": lambda machine, argument: machine.push(machine.stack[-1]),
    "EMPTY_TUPLE": lambda machine, argument: machine.tuple_of(0),
    "TUPLE1": lambda machine, argument: machine.tuple_of(1),
    "TUPLE2": lambda machine, argument: machine.tuple_of(2),
    "TUPLE3": lambda machine, argument: machine.tuple_of(3),
    "TUPLE": lambda machine, argument: machine.push(tuple(machine.to_mark())),
    "EMPTY_LIST": lambda machine, argument: machine.push([]),
    "LIST": lambda machine, argument: machine.push(machine.to_mark()),
    "APPEND": lambda machine, argument: machine.append([machine.pop()]),
    "APPENDS": lambda machine, argument: machine.append(machine.to_mark()),
    "EMPTY_SET": lambda machine, argument: machine.push([]),
    "ADDITEMS": lambda machine, argument: machine.append(machine.to_mark()),
    "FROZENSET": lambda machine, argument: machine.push(machine.to_mark()),
    "EMPTY_DICT": lambda machine, argument: machine.push(_Pairs()),
    "SETITEM": lambda machine, argument: machine.set_items([machine.pop(), machine.pop()][::-1]),
    "SETITEMS": lambda machine, argument: machine.set_items(machine.to_mark()),
    "GLOBAL": lambda machine, argument: machine.name(argument),
    "STACK_GLOBAL": lambda machine, argument: machine.name(None),
    "REDUCE": lambda machine, argument: machine.note(),
    "NEWOBJ": lambda machine, argument: machine.note(),
    "NEWOBJ_EX": lambda machine, argument: machine.note(3),
    "BUILD": lambda machine, argument: machine.build(),
}
"""Opcodes that are read; none that would fetch something from elsewhere."""
