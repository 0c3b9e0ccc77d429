"""Processes: how many fit, how they start, their threads, and locks between them."""

from __future__ import annotations

import ast
import ctypes
import multiprocessing
import os
import pickle
import platform
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import AbstractContextManager, contextmanager
from functools import cache, partial
from multiprocessing import parent_process
from pathlib import Path
from types import FrameType
from typing import Any, Final, TypeVar

from .errors import FileWarning, IntegGymError


@cache
def host() -> str:
    """Operating system and processor, not the machine's own name or kernel."""
    return f"{platform.system()} {platform.machine()}"


def instruction_sets() -> tuple[str, ...]:
    """Processor family, then the vector extensions that numpy found and uses, in its names.

    Whether products and sums are fused decides last bits, and a policy's success after training
    may hang on these.
    """
    import numpy as np

    found = np.show_config(mode="dicts").get("SIMD Extensions", {})
    return (platform.machine(), *found.get("baseline", ()), *found.get("found", ()))


def release_memory() -> None:
    """Give the system back what this process has freed: Arrow's, and what glibc keeps."""
    if "pyarrow" in sys.modules:
        sys.modules["pyarrow"].default_memory_pool().release_unused()
    if platform.libc_ver()[0] == "glibc":
        ctypes.CDLL(None).malloc_trim(0)


Item = TypeVar("Item")

_END: Final = object()


def prefetch(items: Iterator[Item]) -> Iterator[Item]:
    """The same items, each made in another thread while the one before is used.

    What the making of one raises is raised in its place. In a worker, which has one thread, and at
    the end of the process, when none can be started any more, they are made when they are wanted.
    """
    if parent_process() is None:
        with ThreadPoolExecutor(1) as thread:
            following = _submit_next(thread, items)
            while following is not None:
                item = following.result()
                if item is _END:
                    return
                following = _submit_next(thread, items)
                yield item
    yield from items


def _submit_next(thread: ThreadPoolExecutor, items: Iterator[Any]) -> Future[Any] | None:
    """The next item, or the end; None where the interpreter starts no thread any more."""
    try:
        return thread.submit(next, items, _END)
    except RuntimeError:
        return None


_ALONE = ", or ask for one worker (workers=1), which works in this process"


class SpawnError(IntegGymError, RuntimeError):
    """Worker processes cannot be started from here; one sentence says why and what to do."""


def check_spawning(*sent: Any, alone: bool = False) -> None:
    """Check that a fresh process can import this program without running it, and take objects.

    Args:
        sent: what the processes will be given.
        alone: whether one worker would work in this process, which is then said as a remedy.

    Raises:
        SpawnError: in one sentence, if not.
    """
    otherwise = _ALONE if alone else ""
    main = sys.modules["__main__"]
    file = getattr(main, "__file__", None)
    if file is not None:
        path = Path(file)
        if not path.is_file():
            raise SpawnError(
                "a program read from standard input cannot start worker processes, which read it "
                f"again; save it as a file{otherwise}"
            )
        if path.suffix != ".pyc" and not _runs_under_guard(path):
            raise SpawnError(
                f"{path.name} starts worker processes, which import it, without "
                '`if __name__ == "__main__":`; put this call under it' + otherwise
            )
    for one in sent:
        _check_sent(one, file, otherwise)


def _check_sent(sent: Any, file: str | None, otherwise: str) -> None:
    try:
        text = pickle.dumps(sent)
    except Exception as error:  # pickling runs what an object says of itself
        raise SpawnError(
            f"worker processes cannot be given {_label(sent)} ({error}); define it at the top of a "
            f"module{otherwise}"
        ) from error
    if file is None and b"__main__" in text:
        raise SpawnError(
            f"worker processes cannot find {_label(sent)}, which was defined in a notebook or an "
            f"interactive session; define it in a module{otherwise}"
        )


def _label(sent: Any) -> str:
    return repr(getattr(sent, "policy_id", getattr(sent, "__name__", type(sent).__name__)))


def _runs_under_guard(path: Path) -> bool:
    """Whether what runs now in the main program stands under the guard."""
    try:
        tree = ast.parse(path.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return True
    guards = []
    for node in tree.body:
        if isinstance(node, ast.If):
            inner = list(ast.walk(node.test))
            names = {one.id for one in inner if isinstance(one, ast.Name)}
            texts = {one.value for one in inner if isinstance(one, ast.Constant)}
            if "__name__" in names and "__main__" in texts:
                guards.append(node)
    frame: FrameType | None = sys._getframe(1)
    while frame is not None:
        own, code = frame.f_globals.get("__name__") == "__main__", frame.f_code
        if own and code.co_name == "<module>" and Path(code.co_filename).name == path.name:
            line = frame.f_lineno
            return any(node.lineno <= line <= (node.end_lineno or line) for node in guards)
        frame = frame.f_back
    return bool(guards)


_report: Callable[[float], object] | None = None


class Progress:
    """Work done, added up over worker processes, and a bar that shows it.

    Workers call :func:`report_work`.

    Args:
        bar: a `WorkBar`; None for a pool alone.
        starting: what the bar says until some work is done.
    """

    def __init__(self, bar: Any = None, starting: str = "") -> None:
        self._bar = bar
        self._starting = starting
        if starting:
            bar.describe(starting)
        self._context = multiprocessing.get_context("spawn")
        self._done = self._context.Value("d", 0.0)
        self._stopped = self._context.Event()

    def begin_at(self, amount: float) -> None:
        """Begin with work that was done before, which says nothing of how long the rest takes."""
        _add(self._done, amount)
        self._bar.begin_at(amount)

    def add(self, amount: float, show: bool = True) -> None:
        """Count work that was done elsewhere.

        Args:
            amount: of it.
            show: at once; else when the bar moves next, as from another thread.
        """
        _add(self._done, amount)
        if show:
            self._show()

    def ended(self, running: set[Future[Any]]) -> Iterator[Future[Any]]:
        """Tasks as they end, which are taken out; others may be put in meanwhile.

        Until the last has ended, the bar moves with what they report.
        """
        while running:
            ended, _ = wait(running, timeout=0.2, return_when=FIRST_COMPLETED)
            running -= ended
            self._show()
            while ended:  # so that none is kept when it was taken
                yield ended.pop()

    def _show(self) -> None:
        if self._starting and self._done.value:
            self._starting = ""
            self._bar.describe("")
        self._bar.update(self._done.value - self._bar.n)

    def pool(
        self, workers: int, prepare: Callable[[int], None] | None = None
    ) -> ProcessPoolExecutor:
        """A pool of fresh processes that report here.

        An error that leaves its ``with`` block cancels what waits; an interruption ends what runs.

        Args:
            workers: how many.
            prepare: called once in each process, with its number from 0; importable from a module.

        Raises:
            SpawnError: where no process can be started; see :func:`check_spawning`.
        """
        check_spawning()
        watched = os.getpid(), self._stopped
        return _Pool(
            self._stopped,
            max_workers=workers,
            mp_context=self._context,
            initializer=_start_worker,
            initargs=(watched, self._done, self._context.Value("i", 0), prepare),
        )

    def at_once(self) -> Executor:
        """This thread, which does a task when it is submitted and moves the bar meanwhile."""
        return _AtOnce(self.add)


class _Pool(ProcessPoolExecutor):
    def __init__(self, stopped: Any, **arguments: Any) -> None:
        super().__init__(**arguments)
        self._stopped = stopped

    def __exit__(self, kind: type[BaseException] | None, *raised: Any) -> bool | None:
        if kind is not None:
            self.shutdown(wait=False, cancel_futures=True)
            if not issubclass(kind, Exception):
                self._stopped.set()
        return super().__exit__(kind, *raised)


class _AtOnce(Executor):
    def __init__(self, report: Callable[[float], None]) -> None:
        self._report = report

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """A future that has ended; what is no `Exception`, as an interruption, is raised."""
        future: Future[Any] = Future()
        with reported_by(self._report):
            try:
                future.set_result(fn(*args, **kwargs))
            except Exception as error:
                future.set_exception(error)
        return future


def report_work(amount: float) -> None:
    """Add to the work done; without a pool it goes nowhere."""
    if _report is not None:
        _report(amount)


@contextmanager
def reporting() -> Iterator[list[float]]:
    """What is reported in this process while the block lasts, in place of a pool's count."""
    amounts = list[float]()
    with reported_by(amounts.append):
        yield amounts


@contextmanager
def reported_by(report: Callable[[float], object]) -> Iterator[None]:
    """Have work that is reported in this process given to a function while the block lasts."""
    global _report
    before, _report = _report, report
    try:
        yield
    finally:
        _report = before


_SET_BY_THREADPOOLCTL = "KMP_DUPLICATE_LIB_OK"
"""Environment variable that importing threadpoolctl sets for the whole process."""


def limit_threads() -> AbstractContextManager[Any]:
    """One thread for this process's numerical libraries; in a ``with`` block, while it lasts."""
    absent = _SET_BY_THREADPOOLCTL not in os.environ
    from threadpoolctl import threadpool_limits

    if absent:
        os.environ.pop(_SET_BY_THREADPOOLCTL, None)
    limits: AbstractContextManager[Any] = threadpool_limits(limits=1)
    return limits


def peak_memory() -> int | None:
    """Most memory that this process has held, bytes; None where the system does not tell.

    What `getrusage` tells counts the process that this one was started from.
    """
    status = Path("/proc/self/status")
    if not status.exists():
        return None
    lines = status.read_text(encoding="ascii").splitlines()
    (kib,) = (line.split()[1] for line in lines if line.startswith("VmHWM"))
    return 1024 * int(kib)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _start_worker(
    watched: tuple[int, Any], done: Any, started: Any, prepare: Callable[[int], None] | None
) -> None:
    global _report
    _report = partial(_add, done)
    threading.Thread(target=end_with_parent, args=watched, daemon=True).start()
    limit_threads()
    warnings.simplefilter("ignore", FileWarning)
    if prepare is not None:
        with started.get_lock():
            number = started.value
            started.value += 1
        prepare(number)


def _add(done: Any, amount: float) -> None:
    with done.get_lock():
        done.value += amount


def end_with_parent(parent: int, stopped: Any = None) -> None:
    """End this process when its parent is gone or has been interrupted.

    Args:
        parent: its id.
        stopped: an event that is set with an interruption; None without one.
    """
    waiting = threading.Event() if stopped is None else stopped
    while os.getppid() == parent and not waiting.wait(0.5):
        pass
    os._exit(1)
