"""A finished small panel and a finished diagnosis, made once in a run."""

import contextlib
import io
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from small_panel import TOML, pictures_alone

from integ_gym.cli import main


@pytest.fixture(scope="session", autouse=True)
def few_pictures() -> Iterator[None]:
    """See `pictures_alone`; tests of figures ask for every format themselves."""
    with pictures_alone():
        yield


@pytest.fixture(scope="session")
def panel_directory(made_once) -> Path:
    """Directory of a finished run of the small panel, beside its specification."""

    def make(folder: Path) -> None:
        spec, out = folder / "small.toml", folder / "out"
        spec.write_text(TOML, encoding="utf-8")
        given = ["--out", str(out), "--workers", "2", "--no-progress"]
        assert main(["panel", str(spec), *given]) == 0

    return made_once("panel", make) / "out"


@pytest.fixture(scope="session")
def diagnosis(made_once):
    """Directory, result and terminal output of a diagnosis of the pendulum."""
    folder = made_once("diagnosis", _diagnose)
    out = folder / "run"
    result = json.loads((out / "diagnose.json").read_text(encoding="utf-8"))
    return out, result, (folder / "printed.txt").read_text(encoding="utf-8")


def _diagnose(folder: Path) -> None:
    names = ("symplectic_euler", "reference", "planted:Boaster", "planted:Silent")
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        code = main(
            ["diagnose", "--plant", "pendulum", "--integrator", *names,
             "--out", str(folder / "run"), "--workers", "1", "--no-progress", "--all"]
        )  # fmt: skip
    assert code == 0
    (folder / "printed.txt").write_text(printed.getvalue(), encoding="utf-8")
