"""Build wheel and sdist, check them, and use the wheel in an empty environment of each Python.

    .venv/bin/python .ci/release.py --out dist --python python3.11 --python python3.12
    python .ci/release.py --built dist     # uses a wheel that was built before

The wheel is built from the sdist, so that what lacks there lacks here. Each environment gets the
wheel with the extra `panel` and the pins; there the README's first example runs, Gymnasium's
`check_env`, and a small panel down to its page, in a folder that holds nothing else.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parent.parent
_IGNORED = shutil.ignore_patterns(".*", "runs", "build", "dist", "*.egg-info", "__pycache__")
_ABSENT = "is absent from the `packages` configuration"
KINDS = {".py", ".typed", ".toml", ".j2", ".json", ".css", ".js"}

USE = """
import sys
import warnings
from pathlib import Path

import gymnasium as gym
from gymnasium.utils.env_checker import check_env

import integ_gym

assert Path(integ_gym.__file__).is_relative_to(sys.prefix), integ_gym.__file__
for env_id in integ_gym.ENVIRONMENTS:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        check_env(gym.make(env_id, integrator="rk4").unwrapped, skip_render_check=True)
spec = Path("small.toml")
spec.write_text(SPEC, encoding="utf-8")
if __name__ == "__main__":
    panel = integ_gym.run_panel(str(spec), "run", progress=False)
    assert [row.name for row in panel.rows] == ["rk4 dt=0.05", "random", "handmade"]
    assert "</html>" in Path("run", "report.html").read_text(encoding="utf-8")
    assert "torch" not in sys.modules
    print("used", integ_gym.__file__)
"""
SPEC = """
name = "small"
env_id = "IntegPendulum-v0"
control_period = 0.05
seeds = [0]
episodes = 2
baselines = ["random", "handmade"]

[environment]
duration = 2.0

[training]
total_steps = 2048
n_steps = 64

[[train]]
integrator = "rk4"
dt = 0.05

[[evaluate]]
integrator = "rk4"
dt = 0.05
"""


def built(out: Path) -> Path:
    """Build both into a folder, and check them; the wheel.

    Raises:
        SystemExit: in one sentence, for what a file lacks.
        CalledProcessError: if building or twine's check fails.
    """
    with tempfile.TemporaryDirectory() as name:  # building leaves files beside what it builds
        tree = Path(name) / "tree"
        shutil.copytree(ROOT, tree, ignore=_IGNORED)
        said = _run(
            sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(tree)
        )
    if _ABSENT in said:
        raise SystemExit("setuptools names packages that are absent; see setup.py")
    wheel, sdist = max(out.glob("*.whl"), key=_age), max(out.glob("*.tar.gz"), key=_age)
    _run(sys.executable, "-m", "twine", "check", "--strict", str(wheel), str(sdist))
    lacking = _expected() - set(zipfile.ZipFile(wheel).namelist())
    if lacking:
        raise SystemExit(f"{wheel.name} lacks {', '.join(sorted(lacking))}")
    print(f"built {wheel.name}, {sdist.name}", flush=True)
    return wheel


def _age(file: Path) -> float:
    return file.stat().st_mtime


def _expected() -> set[str]:
    """Names in a wheel: every module, and what is read beside them."""
    setup = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]
    return {
        f"{package.replace('.', '/')}/{path.relative_to(ROOT / folder).as_posix()}"
        for package, folder in setup["setuptools"]["package-dir"].items()
        for path in (ROOT / folder).rglob("*")
        if path.suffix in KINDS
    }


def use(wheel: Path, python: str) -> None:
    """Install a wheel in an empty environment of a Python, and use it there.

    Raises:
        CalledProcessError: if anything of it fails.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _run(python, "-m", "venv", str(folder / "venv"))
        own = folder / "venv" / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
        pins = ("--constraint", str(ROOT / "constraints.txt"))
        _run(str(own), "-m", "pip", "install", "--quiet", *pins, f"{wheel}[panel]")
        (folder / "use").mkdir()
        example = re.findall(r"^```python\n(.*?)^```", _readme(), re.DOTALL | re.MULTILINE)[0]
        for program, text in (("example", example), ("use", f"SPEC = {SPEC!r}\n{USE}")):
            file = folder / "use" / f"{program}.py"
            file.write_text(text, encoding="utf-8")
            _run(str(own), str(file), folder=folder / "use")
    print(f"used on {python}", flush=True)


def _readme() -> str:
    return (ROOT / "README.md").read_text(encoding="utf-8")


def _run(*command: str, folder: Path | None = None) -> str:
    """What a command says."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        print(done.stdout, done.stderr, sep="\n", file=sys.stderr)
    done.check_returncode()
    return done.stdout + done.stderr


def main(arguments: Sequence[str] | None = None) -> None:
    """Build, check and use."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder (default: dist)")
    parser.add_argument("--python", action="append", default=[], help="to use the wheel on")
    parser.add_argument("--built", type=Path, help="folder of a wheel to use; builds none")
    parser.add_argument("--tag", help="that names the version, v1.0.0; another is refused")
    given = parser.parse_args(arguments)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    if given.tag not in (None, f"v{project['version']}"):
        raise SystemExit(f"the tag {given.tag} does not name the version {project['version']}")
    wheel = max(given.built.glob("*.whl"), key=_age) if given.built else built(given.out)
    for python in given.python or [sys.executable]:
        use(wheel, python)


if __name__ == "__main__":
    main()
