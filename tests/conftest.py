"""Shared test set-up: what is compiled is kept, and what takes long is made once in a run."""

import importlib
import os
import shutil
import sys
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import hypothesis
import portalocker
import pyarrow.parquet as pq
import pytest

from integ_gym.envs.engines.stepping import missing_modules
from integ_gym.envs.registries import ENGINES
from integ_gym.eval.census.subjects import PUBLISHED, installed
from integ_gym.support.isolated import ISOLATED

ROOT = Path(__file__).parents[1]


def pytest_addoption(parser: pytest.Parser) -> None:
    """``--no-skip``, for machines on which everything is installed."""
    parser.addoption("--no-skip", action="store_true", help="a test that is skipped fails")


def pytest_configure() -> None:
    """Tables are printed in full where no test says how wide the terminal is.

    JAX compiles as in the processes of the fleet trainer, in less time for code that is as fast.
    Numerical libraries have one thread in every process: on arrays as small as here a second one
    waits for the first, on a core that another process of the run could use. How long an example
    takes is the machine's affair: hypothesis judges no time. Environments of their own are not met,
    whether they are set up or not: their exchange is replayed.
    """
    slow = [hypothesis.HealthCheck.too_slow]
    hypothesis.settings.register_profile("any machine", deadline=None, suppress_health_check=slow)
    hypothesis.settings.load_profile("any machine")
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    for apart in ISOLATED.values():
        os.environ[apart.variable] = os.devnull
    os.environ.pop("COLUMNS", None)
    os.unsetenv("COLUMNS")  # as readline sets it, which `os.environ` does not see
    os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=1")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What takes longest begins first: no process waits for the last test of another."""
    items.sort(key=lambda item: "reliability" not in item.nodeid)


def pytest_collection_finish() -> None:
    """Programs that JAX compiles are kept where the fleet trainer keeps its own.

    So the processes of a run share them, and later runs do.
    """
    if "jax" in sys.modules:
        from integ_gym.envs.ops.jax_ops import jax
        from integ_gym.train.fleet.worker import default_cache_dir

        jax.config.update("jax_compilation_cache_dir", str(default_cache_dir()))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


@pytest.fixture(scope="session")
def made_once(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A function of (name, make): a copy of the folder that ``make(folder)`` fills once in a run.

    It is filled by the process whose tests ask first, under a path that is the same for all; each
    process has a copy of its own, which its tests may change.
    """
    base = tmp_path_factory.getbasetemp()
    shared = (base.parent if hasattr(request.config, "workerinput") else base) / "made_once"
    shared.mkdir(exist_ok=True)

    def made(name: str, make: Callable[[Path], object]) -> Path:
        folder, done = shared / name, shared / f"{name}.done"
        with (shared / f"{name}.lock").open("w") as lock:
            portalocker.lock(lock, portalocker.LockFlags.EXCLUSIVE)
            if not done.exists():
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                make(folder)
                done.touch()
        own = tmp_path_factory.mktemp(name) / name
        shutil.copytree(folder, own)
        return own

    return made


@pytest.fixture(scope="session")
def object_server() -> Iterator[dict[str, str]]:
    """What the environment tells of an S3-compatible server on loopback, with an empty bucket."""
    from object_store import served_bucket

    with served_bucket() as told:
        yield told


@pytest.fixture
def bucket(object_server: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> str:
    """A place of a test's own in an object store."""
    for name, value in object_server.items():
        monkeypatch.setenv(name, value)
    from object_store import BUCKET

    return f"{BUCKET}/{uuid.uuid4().hex}"


def pytest_report_header() -> str:
    """What is not tested here."""
    absent = [n for n in ENGINES.names() if n not in ISOLATED and missing_modules(n)]
    here = [name for name in PUBLISHED.names() if PUBLISHED.load(name).apart is None]
    absent += [name for name in here if not installed(name)]
    return (
        f"not installed, and so not tested: {', '.join(absent) or 'nothing'}; in environments of "
        f"their own, and so replayed: {', '.join(ISOLATED)}"
    )


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    """With ``--no-skip``, a skipped test fails with the reason for which it was skipped."""
    report: Any = yield
    if report.skipped and item.config.getoption("--no-skip"):
        report.outcome = "failed"
        report.longrepr = f"skipped: {report.longrepr}"
    return report


@pytest.fixture
def import_experiment(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], Any]]:
    """A function that imports a published experiment's script by its name."""
    folders = (ROOT / "benchmarks" / "tables", ROOT / "benchmarks")
    for folder in folders:
        monkeypatch.syspath_prepend(str(folder))
    before = set(sys.modules)
    yield importlib.import_module
    own = {"measuring", *(script.stem for folder in folders for script in folder.glob("*.py"))}
    for name in set(sys.modules) - before:
        if name.split(".")[0] in own:
            del sys.modules[name]


@pytest.fixture
def read_experiment(import_experiment: Callable[[str], Any]) -> Callable[..., tuple[Any, Any]]:
    """A function that gives an experiment's script, and its published cells."""

    def read(name: str, folder: str = "") -> tuple[Any, Any]:
        script, path = import_experiment(name), ROOT / "docs" / "tables" / name / folder
        rows = pq.read_table(path / "rows.parquet").to_pylist()
        return script, script.Cells(rows, script.TABLE.cell_columns)

    return read
