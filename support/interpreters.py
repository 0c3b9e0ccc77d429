"""Python interpreters with other versions of packages, made by uv, and what is called in them."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
import io
import json
import os
import pickle
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from itertools import takewhile
from pathlib import Path
from typing import Any, Final

from . import optional
from .errors import InputError, IntegGymError
from .files import write_json
from .isolated import last_words
from .processes import check_spawning, report_work
from .storage import FileLock

PACKAGES: Final = "packages"
"""What a cell calls the versions that are judged with, a list such as ``["mujoco==3.2.7"]``."""

OWN = "integ-gym"

_BASE_EXTRAS = ("evidence", "report")
_NOT_IMPORTED = frozenset({"jinja2", "matplotlib"})
"""Of the packages of these extras: what draws pages, which no episode needs."""

_MARKER = "interpreter.json"
_RESOLVED = "requirements.txt"

_PATIENCE = 1800.0
"""Time in which another process makes an interpreter, s."""

_MOST = 300
"""Characters of uv's words that a message quotes."""


class InterpreterError(IntegGymError, RuntimeError):
    """An interpreter that cannot be made, or a call in it that failed; one sentence says why."""


_EXACT = re.compile(r"([A-Za-z0-9][\w.-]*)\s*==\s*([A-Za-z0-9][\w.+!-]*)")


def parse_packages(words: Any) -> tuple[str, ...]:
    """Exact versions of packages, ``"name==version"``, in one form.

    >>> parse_packages(["MuJoCo == 3.2.7"])
    ('mujoco==3.2.7',)

    Raises:
        ValueError: for anything else, for this package itself, and for a package that is there
            twice.
    """
    listed = words if isinstance(words, list | tuple) else [words]
    found = []
    for word in listed:
        match = _EXACT.fullmatch(word.strip()) if isinstance(word, str) else None
        if match is None:
            raise InputError(
                f"`{PACKAGES}` takes exact versions such as mujoco==3.2.7, got {word!r}"
            )
        found.append(f"{_normalize(match[1])}=={match[2]}")
    names = [one.partition("==")[0] for one in found]
    for name in {"python", OWN} & set(names):
        raise InputError(f"`{PACKAGES}` cannot change {name}; install another one for all cells")
    if not found or len(set(names)) < len(names):
        raise InputError(
            f"`{PACKAGES}` takes one version of each package, got {list(listed)}; a list of lists "
            'is several cells: [["mujoco==3.1.0"], ["mujoco==3.2.7"]]'
        )
    return tuple(found)


def _normalize(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def versions_of(packages: Iterable[str]) -> dict[str, str]:
    """Version by name."""
    return {name: version for name, _, version in (one.partition("==") for one in packages)}


def are_running(packages: Iterable[str]) -> bool:
    """Whether this interpreter has these versions."""
    return all(
        optional.package_version(name) == version for name, version in versions_of(packages).items()
    )


def needed_versions(names: Iterable[str] = (), modules: Iterable[str] = ()) -> dict[str, str]:
    """Versions, as they are here, of what is imported where episodes are played.

    Args:
        names: of extras, of engines and of libraries of tasks; what is no extra is left out.
        modules: that a policy needs.
    """
    extras = [name for name in dict.fromkeys(names) if name in optional.extra_names()]
    wanted = {
        *optional.required_by_extra(None),
        *(p for x in (*_BASE_EXTRAS, *extras) for p in optional.required_by_extra(x)),
    }
    wanted |= {p for extra in extras for p in optional.required_by_extra(extra, "gymnasium")}
    for module in {module.partition(".")[0] for module in modules}:
        wanted |= set(_distributions().get(module, ()))
    names_here = {_normalize(name) for name in wanted} - _NOT_IMPORTED - {OWN}
    found = {name: optional.package_version(name) for name in sorted(names_here)}
    return {name: version for name, version in found.items() if version is not None}


@cache
def _distributions() -> Mapping[str, list[str]]:
    return importlib.metadata.packages_distributions()


def modules_in(given: Any) -> frozenset[str]:
    """Modules of the classes and functions that an object is pickled by.

    Raises:
        InputError: for what cannot be given to another process.
    """
    try:
        reader = _Reader(io.BytesIO(pickle.dumps(given)))
        reader.load()
    except Exception as error:  # pickling runs what an object says of itself
        name = getattr(given, "policy_id", type(given).__name__)
        raise InputError(
            f"another interpreter cannot be given {name!r} ({error}); define it at the top of a "
            "module"
        ) from error
    return frozenset(reader.modules)


class _Reader(pickle.Unpickler):
    def __init__(self, content: io.BytesIO) -> None:
        super().__init__(content)
        self.modules: set[str] = set()

    def find_class(self, module: str, name: str) -> Any:
        self.modules.add(module)
        return super().find_class(module, name)


@dataclass(frozen=True)
class Interpreter:
    """An interpreter that has been made.

    Attributes:
        folder: its environment.
        packages: what was changed.
    """

    folder: Path
    packages: tuple[str, ...]


def _python(folder: Path) -> Path:
    """The program of an environment."""
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def interpreters_folder() -> Path:
    """Where interpreters are kept: in the user's cache."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "integ-gym" / "interpreters"


def find_interpreter(packages: Sequence[str], needed: Mapping[str, str]) -> Interpreter | None:
    """One that has been made with these versions, and has all that is needed as it is here."""
    wanted = {**needed, **versions_of(packages)}
    found = []
    for marker in interpreters_folder().glob(f"*/{_MARKER}"):
        known = json.loads(marker.read_text(encoding="utf-8"))
        same = known["own"] == _own() and sorted(known["packages"]) == sorted(packages)
        if same and wanted.items() <= known["versions"].items() and _python(marker.parent).exists():
            found.append((len(known["versions"]), marker.parent))
    if not found:
        return None
    return Interpreter(max(found)[1], tuple(packages))


def make_interpreter(
    packages: Sequence[str],
    needed: Mapping[str, str],
    report: Callable[[str], object] = lambda words: None,
) -> Interpreter:
    """An interpreter with these versions, made if it is not there.

    Args:
        packages: that are changed.
        needed: versions of the others.
        report: called with a sentence on each thing that is done.

    Raises:
        InterpreterError: where it cannot be made, with uv's own words.
        ModuleNotFoundError: without uv, with the command that installs it.
    """
    found = find_interpreter(packages, needed)
    if found is not None:
        return found
    wanted = {**needed, **versions_of(packages)}
    asked = {"own": _own(), "packages": sorted(packages), "versions": wanted}
    name = hashlib.sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()[:16]
    folder = interpreters_folder() / name
    folder.parent.mkdir(parents=True, exist_ok=True)
    with _hold_lock(folder.with_suffix(".lock")):
        if not (folder / _MARKER).exists():
            report(f"making an interpreter with {' '.join(packages)}")
            shutil.rmtree(folder, ignore_errors=True)
            _install(folder, packages, wanted)
            write_json(folder / _MARKER, asked)
    return Interpreter(folder, tuple(packages))


@contextmanager
def _hold_lock(path: Path) -> Iterator[None]:
    """Hold a lock, which another process may have for as long as it makes the interpreter."""
    lock, until = FileLock(path), time.monotonic() + _PATIENCE
    while not lock.acquire():
        if time.monotonic() > until:
            raise InterpreterError(f"another process has held {path} too long; end it, and go on")
        time.sleep(0.2)
    try:
        yield
    finally:
        lock.release()


def _own() -> dict[str, str]:
    """What an interpreter has as this one: Python, machine, and this package with its source."""
    source, _ = _own_source()
    build = f"{platform.python_implementation()} {platform.python_version()}"
    return {
        "python": build, "platform": f"{sys.platform} {platform.machine()}",
        "version": optional.package_version(OWN) or "unknown", "source": source,
    }  # fmt: skip


@cache
def _own_source() -> tuple[str, tuple[str, ...]]:
    """Where this package was installed from, and what uv needs to install it from there.

    Raises:
        InterpreterError: for a copy of a folder, which may have changed since.
    """
    folder = optional.checkout()
    if folder is not None:
        return str(folder), ("--editable", str(folder))
    found = importlib.metadata.distributions(name=OWN)
    origins = (json.loads(own.read_text("direct_url.json") or "{}") for own in found)
    origin = next((one for one in origins if "url" in one), None)
    if origin is None:
        return "", (f"{OWN}=={optional.package_version(OWN)}",)
    if "dir_info" in origin:
        raise InterpreterError(
            f"{OWN} is a copy of {origin['url']}, which may have changed since; install that "
            "folder with pip install -e"
        )
    url = origin["url"]
    if "vcs_info" in origin:
        url = f"{origin['vcs_info']['vcs']}+{url}@{origin['vcs_info']['commit_id']}"
    return url, (f"{OWN} @ {url}",)


def find_uv() -> list[str]:
    """The command that runs uv: the installed package's, or the one on the path.

    Raises:
        ModuleNotFoundError: without one, with the command that installs it.
    """
    if importlib.util.find_spec("uv") is not None:
        return [sys.executable, "-m", "uv"]
    program = shutil.which("uv")
    if program is None:
        raise optional.missing_package("uv", "versions")
    return [program]


def _install(folder: Path, packages: Sequence[str], wanted: Mapping[str, str]) -> None:
    """Make the environment: what is wanted, what that needs as near as can be to what is here."""
    uv, base = find_uv(), getattr(sys, "_base_executable", sys.executable)
    python, resolved = str(_python(folder)), folder / _RESOLVED
    _run_uv(packages, [*uv, "venv", "--python", base, str(folder)])
    asked = folder / "asked.txt"
    asked.write_text(_lines(wanted), encoding="utf-8")
    preferred = {**_read_installed(sys.path), **wanted}
    resolved.write_text(_lines(preferred), encoding="utf-8")
    compile_options = ["--no-header", "--no-annotate", "--python", python]
    _run_uv(
        packages,
        [*uv, "pip", "compile", str(asked), "--output-file", str(resolved), *compile_options],
    )
    install = [*uv, "pip", "install", "--python", python, "--no-deps"]
    _run_uv(packages, [*install, "--requirements", str(resolved)])
    _run_uv(packages, [*install, *_own_source()[1]])
    _check_installed(folder, packages, {**wanted, OWN: optional.package_version(OWN) or "unknown"})


def _lines(versions: Mapping[str, str]) -> str:
    return "".join(f"{name}=={version}\n" for name, version in sorted(versions.items()))


def _run_uv(packages: Sequence[str], command: Sequence[str]) -> None:
    others = {name: x for name, x in os.environ.items() if name != "VIRTUAL_ENV"}
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, encoding="utf-8", errors="replace",
        env={**others, "UV_NO_PROGRESS": "1", "NO_COLOR": "1"},
    )  # fmt: skip
    if done.returncode:
        raise InterpreterError(
            f"no interpreter with {' '.join(packages)} can be made, uv says: "
            f"{_uv_words(done.stderr)}; give versions that there are for Python "
            f"{platform.python_version()} and that fit the other packages, and let uv reach its "
            "registry, or set UV_OFFLINE=1 if they were downloaded before"
        )


def _uv_words(text: str) -> str:
    """What uv says last: the cause of its error, on one line."""
    lines = [line.strip(" ×│├╰─▶▸") for line in text.splitlines()]
    causes = [k for k, line in enumerate(text.splitlines()) if "╰─▶" in line]
    last = next(filter(None, reversed(lines)), "nothing")
    cause = " ".join(takewhile(bool, lines[causes[-1] :])) if causes else last
    return cause[:_MOST].rstrip(".")


def _check_installed(folder: Path, packages: Sequence[str], wanted: Mapping[str, str]) -> None:
    """Hold what was installed against what was wanted.

    Raises:
        InterpreterError: for another version, as of a checkout that was changed since.
    """
    found = _read_installed([str(path) for path in folder.glob("[Ll]ib/**/site-packages")])
    for name, version in wanted.items():
        there = found.get(name)
        if there != version:
            remedy = f"install {name} here again, as `uv` finds another one now"
            if name in versions_of(packages):
                remedy = f"write {name}=={there}" if there else "name a version that installs"
            raise InterpreterError(
                f"no interpreter with {' '.join(packages)} can be made: it has {name} {there}, and "
                f"{version} is wanted; {remedy}"
            )


def _read_installed(folders: Sequence[str]) -> dict[str, str]:
    """Versions of the packages that are installed in folders, by name."""
    found = importlib.metadata.distributions(path=list(folders))
    return {_normalize(one.metadata["Name"]): one.version for one in found}


_SERVING = "integ_gym.support.interpreter_calls"


def call_there(
    interpreter: Interpreter, function: Callable[..., Iterable[Any]], *given: Any, **named: Any
) -> Iterator[Any]:
    """What a function yields in another interpreter, as it comes; work is reported here.

    Args:
        interpreter: that has been made.
        function: of a module, whose results can be pickled.
        given: its arguments.
        named: further ones.

    Raises:
        InterpreterError: for any error there, in one sentence.
    """
    task = pickle.dumps((function, given, named))
    asked = {
        "packages": interpreter.packages,
        "paths": _further_paths(),
        "main": None,
        "task": task,
    }
    if {"__main__", "__mp_main__"} & modules_in((function, given, named)):
        check_spawning(given)
        asked["main"] = getattr(sys.modules["__main__"], "__file__", None)
    environment = {**os.environ, optional.ANY_VERSION: "*"}
    with tempfile.TemporaryFile() as words:
        process = subprocess.Popen(
            [str(_python(interpreter.folder)), "-m", _SERVING],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=words, env=environment,
        )  # fmt: skip
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            with suppress(BrokenPipeError):
                pickle.dump(asked, process.stdin)
                process.stdin.close()
            yield from _answers(process.stdout, interpreter.packages, words)
        finally:
            process.kill()
            process.wait()
            process.stdout.close()


def _answers(answers: Any, packages: Sequence[str], words: Any) -> Iterator[Any]:
    named = " ".join(packages)
    while True:
        try:
            kind, value = pickle.load(answers)
        except (EOFError, pickle.UnpicklingError):
            last = last_words(words)
            raise InterpreterError(f"the interpreter with {named} ended too early{last}") from None
        if kind == "work":
            report_work(value)
        elif kind == "value":
            yield value
        elif kind == "error":
            raise InterpreterError(f"with {named}: {value}")
        else:
            return


def _further_paths() -> list[str]:
    """Folders that modules are imported from here and that belong to no installation."""
    own = [Path(prefix).resolve() for prefix in (sys.prefix, sys.base_prefix, sys.exec_prefix)]
    own += [Path(os.__file__).resolve().parent]
    paths = [Path(entry or ".").resolve() for entry in sys.path]
    return [
        str(path)
        for path in paths
        if path.is_dir() and not any(path.is_relative_to(prefix) for prefix in own)
        and path.name not in ("site-packages", "dist-packages")
    ]  # fmt: skip


def describe_versions(packages: Iterable[str]) -> dict[str, str]:
    """Versions of these packages as they are here, without Python's."""
    found = optional.installed_versions(versions_of(packages))
    return {name: version for name, version in found.items() if name != "python"}
