"""``integ-gym census``: what every step is, found from outside."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import planted_library as planted
import pytest
from driving import assert_fits
from engine_cases import FIRST, lighter, needs
from house import page_text

from integ_gym.cli import main
from integ_gym.envs.engines.stepping import integrators_of
from integ_gym.envs.numerics.stepping import one_step
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.registries import ENGINES
from integ_gym.eval.census import page as words
from integ_gym.eval.census.measuring import measure
from integ_gym.eval.census.page import render_census
from integ_gym.eval.census.subjects import (
    PUBLISHED,
    Statement,
    engine_subjects,
    installed,
)

DOCS = page_text("docs/explanation/census.md")


def rows_with(*texts: str) -> list[list[str]]:
    """Cells of the rows of the page's tables that contain all of some texts."""
    rows = (line for line in DOCS.splitlines() if line.startswith("|"))
    return [
        [cell.strip() for cell in row.strip("|").split(" | ")]
        for row in rows
        if all(text in row for text in texts)
    ]


def assert_published(line: dict[str, Any]) -> list[str]:
    """Of a version, what an environment applies, and what it says, is in the page; the row."""
    (row,) = rows_with(f"`{line['name']}` | {line['source']} {line['version']} |")
    assert row[2].strip("`") == words.applied(line)
    assert [row[3], row[-1]] == [words.found_steps(line), words.stated(line)]
    return row


HERE = [name for name in PUBLISHED.names() if PUBLISHED.load(name).apart is None]
"""Libraries without an environment of their own: of others, the exchange is replayed elsewhere."""


@pytest.mark.slow
@pytest.mark.parametrize("library", HERE)
def test_published_environments_are_identified(library: str, tmp_path: Path) -> None:
    """In a process that ends, since what libraries set in theirs would stay.

    dm_control takes over MuJoCo's warnings, for one.
    """
    if not installed(library):
        pytest.skip(f"{library} is not installed; run: {PUBLISHED.load(library).install}")
    command = [sys.executable, "-m", "integ_gym.cli", "census", "--published", library]
    done = subprocess.run(
        [*command, "--out", str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    lines = json.loads((tmp_path / "census.json").read_text("utf-8"))["lines"]
    title = re.escape(PUBLISHED.load(library).title)
    told = re.findall(rf"^\| `(.+)` \| {title} [\d.]+ \|", DOCS, re.MULTILINE)
    assert sorted(line["name"] for line in lines) == sorted(told) != []
    for line in lines:
        assert_published(line)


@pytest.mark.parametrize(("engine", "integrator"), lighter(FIRST))
def test_what_an_engine_applies_is_what_it_is_said_to(engine: str, integrator: str) -> None:
    """Of engines that compile, in `make test-slow`; the native one is in `census`."""
    needs(engine)
    for subject in engine_subjects(engine, (integrator,)):
        line = measure(subject)
        assert line.found.identified, subject
        assert line.found.map == ENGINES.load(engine).maps[integrator], subject
        assert line.differences == (), subject


LIMITED = Statement(0.05, max_speed=6.0)


@pytest.mark.parametrize(
    ("step", "stated", "found", "differences"),
    [
        (one_step("symplectic_euler", planted.PENDULUM, 0.04), None, ("symplectic_euler", 1, 0.04),
         "said to take 0.05 s a control period, takes 0.04 s"),
        (one_step("explicit_euler", planted.PENDULUM, 0.05), None, ("explicit_euler", 1, 0.05),
         "said to be symplectic_euler, is explicit_euler"),
        (planted.repeated(one_step("symplectic_euler", planted.PENDULUM, 0.0125), 4), None,
         ("symplectic_euler", 4, 0.0125), "said to take 1 steps a control period, takes 4"),
        (planted.repeated(one_step("rk4", planted.PENDULUM, 0.02), 2), Statement(0.05),
         ("rk4", 2, 0.02), "said to take 0.05 s a control period, takes 0.04 s"),
        (planted.limited(20.0, "cut"), None, ("symplectic_euler", 1, 0.05),
         "cuts speeds at 20 without saying so"),
        (one_step("rk4", planted.PENDULUM, 0.05), LIMITED, ("rk4", 1, 0.05),
         "said to cut speeds at 6, does not"),
        (planted.dragged, None, ("symplectic_euler", 1, 0.05),
         "is slower than its map at high speeds"),
    ],
)  # fmt: skip
def test_what_is_not_as_stated_is_found_out(
    step: Any, stated: Statement | None, found: tuple[str, int, float], differences: str
) -> None:
    line = measure(planted.subject(step, *([stated] if stated else [])))
    assert line.found.identified
    assert (line.found.map, line.found.substeps) == found[:2]
    assert line.found.dt == pytest.approx(found[2], rel=1e-6)
    assert line.differences == (differences,)


def test_an_unknown_map_is_not_given_a_name() -> None:
    """Nor is hidden damping."""
    line = measure(planted.subject(planted.drift_kick_drift))
    assert not line.found.identified
    assert line.speed_limit is None
    assert "no known map" in line.differences[0]
    damped = Pendulum(damping=0.01)
    line = measure(planted.subject(one_step("symplectic_euler", damped, 0.05)))
    assert not line.found.identified
    assert line.drift.end < -0.1


@pytest.mark.parametrize(
    ("make", "moves_by"), [(planted.subject, "cut"), (planted.watched, "uncut")]
)
def test_a_speed_limit_is_found_with_what_moves_the_position(make: Any, moves_by: str) -> None:
    stated = Statement(0.05, map="symplectic_euler", max_speed=6.0)
    line = measure(make(planted.limited(6.0, moves_by), stated))
    assert line.found.identified
    assert line.speed_limit.limit == pytest.approx(6.0)
    assert line.speed_limit.moves_by == moves_by
    assert len(line.differences) == (moves_by == "uncut")


def test_watched_episodes_say_the_same_as_states_that_are_set() -> None:
    line = measure(planted.watched(one_step("stormer_verlet", planted.PENDULUM, 0.05)))
    assert line.found.map == "stormer_verlet"
    assert line.differences == ("said to be symplectic_euler, is stormer_verlet",)
    assert line.drift.start == (pytest.approx((1.4,)), (0.0,))
    assert 1e-3 < line.drift.largest < 2e-2


def test_damping_is_no_drift() -> None:
    damped = Pendulum(damping=0.1)
    line = measure(planted.subject(one_step("rk4", damped, 0.05), Statement(0.05), damped))
    assert line.drift.exact_energies[-1] < 0.6
    assert line.drift.largest < 1e-4


@pytest.fixture(scope="module")
def census(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("census")
    libraries = ["gymnasium", *(f"planted_library:{n}Library" for n in ("Planted", "Absent"))]
    assert main(["census", "--published", *libraries, "--engine", "native", "--out", str(out)]) == 0
    return out


@pytest.fixture
def document(census: Path) -> Any:
    return json.loads((census / "census.json").read_text("utf-8"))


def test_the_document_holds_every_line(document: Any) -> None:
    native = [line for line in document["lines"] if line["source"] == "native"]
    assert [line["name"] for line in native] == [*integrators_of("native")] * 2
    for line in native:
        assert line["found"]["identified"]
        assert line["found"]["map"] == line["name"]
    assert document["missing"] == {"absent": "pip install absent"}
    (wrong,) = [line for line in document["lines"] if line["differences"]]
    assert (wrong["source"], wrong["plant"]) == ("planted", "cart_pole")
    assert wrong["found"]["dt"] == pytest.approx(0.01)
    assert "census --published gymnasium" in document["command"]


def test_gymnasium_drifts_as_its_maps_do_and_cuts_the_speed_before_the_angle_moves(
    document: Any,
) -> None:
    """Released 90° from hanging: figures of docs/explanation/verification.md at these steps."""
    found = {line["name"]: line for line in document["lines"] if line["source"] == "Gymnasium"}
    pendulum, cart_pole = found["Pendulum-v1"], found["CartPole-v1"]
    limit = pendulum["speed_limit"]
    assert (limit["limit"], limit["moves_by"]) == (8.0, "cut")
    limit = cart_pole["speed_limit"]
    assert (limit["limit"], limit["fastest"]) == (None, 40.0)
    assert pendulum["drift"]["largest"] == pytest.approx(0.0906, abs=5e-5)
    assert pendulum["drift"]["duration"] == pytest.approx(10.0)
    assert cart_pole["drift"]["end"] == pytest.approx(1.7226, abs=5e-5)


def test_the_published_result_is_what_is_measured(document: Any) -> None:
    for line in document["lines"]:
        end, largest = words.energy(line)
        if line["source"] == "Gymnasium":
            row = assert_published(line)
            assert row[5:8] == [words.error(line["found"]["truth_defect"]), end, largest]
            assert row[8] == words.speed_limit(line)
        elif line["source"] == "native":
            rows = rows_with(f"| `{line['found']['map']}` |", f"native `{line['name']}`")
            assert rows[("pendulum", "cart_pole").index(line["plant"])][4] == end


def test_the_page_is_one_file_that_loads_nothing(census: Path, document: Any) -> None:
    html = (census / "census.html").read_text("utf-8")
    assert "default-src 'none'" in html
    assert not re.search(r"(?:src|href)\s*=\s*[\"'](?!#|data:)", html)
    assert "said to take 0.02 s a control period, takes 0.01 s" in html
    assert "pip install absent" in html
    document["lines"][0]["note"] = "<script>alert(1)</script>"
    assert "<script>alert" not in render_census(document)


@pytest.mark.slow
def test_the_page_fits_a_desktop_and_a_phone(document: Any, tmp_path: Path) -> None:
    published = [line for line in document["lines"] if line["published"]]
    pages = {"whole": document, "published": {**document, "lines": published}}
    assert_fits(tmp_path, {name: render_census(one) for name, one in pages.items()})


def test_a_library_that_fails_is_named_and_the_others_are_looked_at(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [f"planted_library:{n}Library" for n in ("Broken", "Planted")]
    assert main(["census", "--published", *names, "--out", str(tmp_path)]) == 1
    told = capsys.readouterr().out
    assert "broken: could not be looked at: AttributeError" in told
    assert "planted Planted-v0 (cart_pole): said to take 0.02 s" in told
    assert len(json.loads((tmp_path / "census.json").read_text("utf-8"))["lines"]) == 2


@pytest.mark.parametrize(
    ("given", "guess"),
    [(["--engine", "mujco"], "Did you mean 'mujoco'?"), (["--published", "gymnasia"], "gymnasium")],
)
def test_unknown_names_are_refused(
    given: list[str], guess: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["census", *given, "--out", str(tmp_path)]) == 2
    assert guess in capsys.readouterr().err


def test_the_documented_library_is_found_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (block,) = re.findall(r"^```python\n(# my_library.*?)^```", DOCS, re.DOTALL | re.MULTILINE)
    (tmp_path / "my_library.py").write_text(block, "utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    given = ["--published", "my_library:MyLibrary", "--out", str(tmp_path / "out")]
    assert main(["census", *given]) == 0
    (said,) = re.findall(r"^```text\n(.*?)\n```", DOCS, re.DOTALL | re.MULTILINE)
    assert said in capsys.readouterr().out
