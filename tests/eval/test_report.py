"""The report and the figures of a panel."""

from __future__ import annotations

import base64
import copy
import hashlib
import re
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import matplotlib
import matplotlib.image
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

import report_example as example
from browsing import assert_fits, browser, complaints

from integ_gym.eval import figures, report
from integ_gym.eval.report_data import Panel, compact, fixed, seconds

PANELS: dict[str, Callable[[], dict[str, Any]]] = {
    "full": example.full_panel,
    "given": example.given_panel,
    "nothing learned": example.nothing_learned_panel,
    "none": example.none_panel,
    "hostile": example.hostile_panel,
    "large": example.large_panel,
}
VOID = {"meta", "link", "br", "wbr", "hr", "img", "input"}
SECTIONS = [
    "verdicts", "matrix", "conclude", "gaps", "remedy", "energy", "ladder", "checks", "failures",
    "comparisons", "method", "reproduce", "records",
]  # fmt: skip


class Page(HTMLParser):
    """A page's elements; fails on tags that do not balance."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.text = ""
        self.scripts: list[str] = []
        self._open: list[str] = []
        self.feed(html)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {name: value or "" for name, value in attrs}))
        if tag not in VOID:
            self._open.append(tag)
        if tag == "script":
            self.scripts.append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {name: value or "" for name, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        assert self._open
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] == "script":
            self.scripts[-1] += data
        elif not self._open or self._open[-1] != "style":
            self.text += data

    def values(self, name: str) -> list[str]:
        """All values of an attribute."""
        return [attributes[name] for _, attributes in self.tags if name in attributes]


@cache
def panel_of(name: str) -> dict[str, Any]:
    return PANELS[name]()


@cache
def page_of(name: str) -> Page:
    return Page(report.render(panel_of(name)))


every_panel = pytest.mark.parametrize("name", list(PANELS))


@every_panel
def test_writes_one_file_with_the_rendered_page(name: str, tmp_path: Path) -> None:
    path = report.write_report(panel_of(name), tmp_path / "new" / "panel")
    assert path == tmp_path / "new" / "panel" / "report.html"
    assert [entry.name for entry in path.parent.iterdir()] == ["report.html"]
    assert path.read_text("utf-8") == report.render(panel_of(name))


@every_panel
def test_ids_differ_and_every_inner_link_leads_somewhere(name: str) -> None:
    page = page_of(name)
    ids = page.values("id")
    assert len(ids) == len(set(ids))
    inner = {link[1:] for link in page.values("href") if link.startswith("#")}
    assert inner <= set(ids)
    assert set(SECTIONS) <= inner
    assert [place for place in ids if place in SECTIONS] == SECTIONS


@every_panel
def test_loads_nothing_and_links_only_beside_itself(name: str) -> None:
    page = page_of(name)
    assert page.values("src") == []
    for link in page.values("href"):
        assert link.startswith(("#", "./")) or link == "data:,"
    assert not {tag for tag, _ in page.tags} & {"iframe", "img", "object", "embed", "base"}
    html = report.render(panel_of(name))
    assert "url(" not in html
    assert "@import" not in html
    assert not re.search(r"https?://", html)


@every_panel
def test_only_its_own_script_can_run(name: str) -> None:
    page = page_of(name)
    assert len(page.scripts) == 1
    digest = base64.b64encode(hashlib.sha256(page.scripts[0].encode()).digest()).decode()
    policy = next(value for value in page.values("content") if "default-src" in value)
    assert f"script-src 'sha256-{digest}'" in policy
    assert "default-src 'none'" in policy
    assert not [a for _, attributes in page.tags for a in attributes if a.startswith("on")]


@every_panel
def test_every_entry_of_the_matrix_has_its_record_and_every_grid_cell_its_place(name: str) -> None:
    panel, page = Panel(panel_of(name)), page_of(name)
    ids = set(page.values("id"))
    assert {entry.anchor for entry in panel.entries.values()} <= ids
    links = page.values("href")
    for entry in panel.entries.values():
        if entry.cell in panel.columns:
            assert f"#{entry.anchor}" in links
    shown = [t for t in page.values("title") if "evaluated on" in t and "success" in t]
    assert len(shown) == sum(e.cell in panel.columns for e in panel.entries.values())


@every_panel
def test_nothing_unknown_is_printed_as_code(name: str) -> None:
    page = page_of(name)
    words = page.text + " ".join(page.values("title") + page.values("aria-label"))
    assert not re.search(r"\b(None|nan|NaN|inf|Undefined)\b", words)
    assert ("{{" in words) == (name == "hostile")


def test_hostile_text_stays_text() -> None:
    page = page_of("hostile")
    assert example.HOSTILE in page.text
    assert f"Does a policy trained on one integrator survive another?{example.HOSTILE}" in page.text
    assert "49" not in page.text.split("Verdicts on the declared family")[0]
    assert "./javascript%3Aalert%281%29" in page.values("href")
    assert "./evil.example/x" in page.values("href")


def test_the_answer_comes_first_and_numbers_are_the_panels() -> None:
    panel, page = panel_of("full"), page_of("full")
    text = " ".join(page.text.split())
    places = [text.index(panel[name]) for name in ("question", "answer")]
    assert places == sorted(places)
    assert places[1] < text.index("Verdicts on the declared family")
    for judged in panel["verdicts"]:
        assert judged["reason"].replace(" -0.", " −0.") in text
    links = [unquote(link) for link in page.values("href")]
    for entry in panel["matrix"]:
        assert entry["query"] in page.text
        assert f"./{entry['file']}" in links
        assert fixed(entry["success"]["estimate"]) in text
    for failure in panel["failures"]:
        assert f"integ-gym evidence show runs/panel {failure['record_id']}" in page.text
    assert panel["command"] in page.text
    assert "10 min 11 s" in text


def test_says_what_is_false_in_plain_words() -> None:
    found = Panel(panel_of("full")).findings
    assert found[0].kind == "agreement"
    classes = [entry["reference_class"] for entry in panel_of("full")["matrix"]]
    passes, fails = classes.count("false_pass"), classes.count("false_fail")
    assert f"{passes} false passes and {fails} false fails do not." in found[0].lead
    artefact = next(finding for finding in found if finding.kind == "false_pass")
    assert artefact.lead.startswith("The policies trained on explicit_euler dt=0.05 reach 1.00")
    assert "belongs to the simulator, not to the physics" in artefact.lead
    assert any("would be thrown away" in finding.lead for finding in found)


def test_without_classes_it_says_so() -> None:
    panel = example.full_panel()
    for entry in panel["matrix"]:
        entry["reference_class"] = None
    assert [finding.kind for finding in Panel(panel).findings] == ["missing"]


def test_one_seed_gets_no_verdict_and_a_warning() -> None:
    text = " ".join(page_of("given").text.split())
    assert "declares no family" in text
    assert "below 5 seeds nothing is concluded" in text
    assert "The policy file names no training discretization." in text


def test_rows_that_did_not_learn_have_no_gap() -> None:
    panel = Panel(panel_of("nothing learned"))
    assert panel.declared_gaps == ()
    assert panel.exploratory_gaps == ()
    text = " ".join(page_of("nothing learned").text.split())
    assert "1 not learned" in text
    assert "there is nothing to transfer" in text


def test_groups_are_integrators_from_coarse_to_fine_with_the_reference_last() -> None:
    groups = Panel(panel_of("full")).groups
    assert [group.label for group in groups] == [*example.SCHEMES, "reference"]
    assert [cell.dt for cell in groups[0].cells] == sorted(example.STEPS, reverse=True)
    assert groups[-1].reference


def test_ladders_keep_the_two_control_periods_apart() -> None:
    ladder = Panel(panel_of("full")).ladders[0]
    for rungs in ladder.fixed.values():
        assert {rung.entry.cell.control_period for rung in rungs} == {example.PERIOD}
    for rungs in ladder.following.values():
        assert [rung.entry.cell.control_period for rung in rungs] == [rung.dt for rung in rungs]
    assert set(ladder.following) == {
        "explicit_euler", "symplectic_euler", "rk4", "implicit_euler",
    }  # fmt: skip


def test_ladders_leave_out_engines_that_a_row_was_not_trained_on() -> None:
    panel = copy.deepcopy(panel_of("full"))
    for cell in panel["cells"]:
        if cell["integrator"] == "implicit_midpoint":
            cell["engine"] = "mujoco"
    read = Panel(panel)
    assert "mujoco implicit_midpoint" in [group.label for group in read.groups]
    assert all("rk4" in ladder.fixed for ladder in read.ladders)
    assert not any("mujoco implicit_midpoint" in ladder.fixed for ladder in read.ladders)


def test_engines_have_a_section_where_a_panel_has_them() -> None:
    line = {
        "engine": "drake", "integrator": "radau1", "map": "implicit_euler", "dt": 0.05,
        "twin": "implicit_euler dt=0.05", "success": 0.25, "twin_success": 0.5, "differing": 7,
        "episodes": 28, "largest": 0.75,
    }  # fmt: skip
    alone = {**line, "integrator": "runge_kutta5", "twin": None, "differing": None}
    page = report.render({**panel_of("full"), "engine_agreement": [line, alone]})
    for text in ('id="engines"', "drake radau1", "7 of 28", "0.75"):
        assert text in page
    assert 'id="engines"' not in report.render(panel_of("full"))


def test_checks_compare_the_same_discretization() -> None:
    checks = Panel(panel_of("full")).checks
    assert list(checks) == ["mass +20 %", "latency 50 ms"]
    for found in checks.values():
        for check in found:
            assert check.before is not None
            assert check.before.row == check.after.row
            assert check.before.cell.integrator == check.after.cell.integrator
            assert check.before.cell.dt == check.after.cell.dt


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema_version": 2}, "expected panel schema_version 1, got 2"),
        ({"rows": [{"name": "a"}, {"name": "a"}]}, "row names that differ, got 'a' twice"),
        ({"matrix": [{"row": "x", "cell": "y"}]}, "do not declare both"),
    ],
)
def test_contradictions_are_refused(change: dict[str, Any], message: str, tmp_path: Path) -> None:
    panel = {**example.given_panel(), **change}
    with pytest.raises(ValueError, match=re.escape(message)):
        report.write_report(panel, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_an_almost_empty_panel_still_reads(tmp_path: Path) -> None:
    panel = {"schema_version": 1, "name": "empty"}
    Page(report.render(panel))
    assert figures.write_figures(panel, tmp_path) == []


def test_a_failed_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = report.write_report(panel_of("given"), tmp_path)
    before = path.read_bytes()

    def broken(source: Path, target: Path) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("os.replace", broken)
    with pytest.raises(OSError, match="disk full"):
        report.write_report(panel_of("full"), tmp_path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("module", ["jinja2", "matplotlib"])
def test_a_missing_extra_names_its_remedy(
    module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    report._template.cache_clear()
    write: Any = report.write_report if module == "jinja2" else figures.write_figures
    with pytest.raises(ModuleNotFoundError) as caught:
        write(panel_of("given"), tmp_path)
    assert str(caught.value) == (f'{module} is not installed; run: pip install "integ-gym[report]"')


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (8.04, "+8.0"),
        (0.0995, "+0.10"),
        (-13.2, "−13"),
        (1234.0, "+1200"),
        (-3.04e-12, "−3.0·10⁻¹²"),
        (0.0, "0"),
        (None, "–"),
        (float("nan"), "–"),
    ],
)
def test_numbers_keep_two_digits(value: float | None, text: str) -> None:
    assert compact(value, 2, True) == text


def test_numbers_have_true_minus_signs_and_no_negative_zero() -> None:
    assert fixed(-0.25) == "−0.25"
    assert fixed(-0.001) == "0.00"
    assert fixed(0.001, sign=True) == "0.00"
    assert [seconds(value) for value in (0.25, 61.0, 7260.0, None)] == [
        "0.25 s", "1 min 1 s", "2 h 1 min", "–",
    ]  # fmt: skip


def test_success_colours_are_viridis_and_their_text_is_legible() -> None:
    for rate in np.linspace(0.0, 1.0, 101):
        colour = report.success_colour(float(rate))
        mapped = matplotlib.colormaps["viridis"](float(rate))[:3]
        assert np.allclose(matplotlib.colors.to_rgb(colour), mapped, atol=0.02)
        light, dark = sorted(map(luminance, (colour, report.ink_on(colour))), reverse=True)
        assert (light + 0.05) / (dark + 0.05) >= 4.5


def luminance(colour: str) -> float:
    """Relative luminance as the web's contrast rules define it."""
    channels = np.array(matplotlib.colors.to_rgb(colour))
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


# Figures ----------------------------------------------------------------------------------------

ALL_FIGURES = [
    "success_matrix.png",
    "transfer_gaps.png",
    "energy_residual.png",
    "refinement_ladder.png",
    "perturbations.png",
    "remedy.png",
]


def pixels(path: Path) -> Any:
    return matplotlib.image.imread(path)[..., :3]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Figures of the full panel."""
    before = dict(matplotlib.rcParams)
    folder = tmp_path_factory.mktemp("panel") / "figures"
    written = figures.write_figures(panel_of("full"), folder)
    assert dict(matplotlib.rcParams) == before
    assert sorted(entry.name for entry in folder.iterdir()) == sorted(ALL_FIGURES)
    return written


def test_figures_are_drawn_sharp_and_not_blank(drawn: list[Path]) -> None:
    assert [path.name for path in drawn] == ALL_FIGURES
    for path in drawn:
        image = pixels(path)
        assert min(image.shape[:2]) > 700
        assert 0.02 < np.mean(np.any(image < 0.95, axis=-1)) < 0.8


def test_figures_show_the_data(drawn: list[Path], tmp_path: Path) -> None:
    other = figures.write_figures(example.full_panel(seed=9), tmp_path)
    for first, second in zip(drawn, other, strict=True):
        a, b = pixels(first), pixels(second)
        assert a.shape != b.shape or np.any(a != b, axis=-1).mean() > 0.001


@pytest.mark.slow
def test_the_same_panel_gives_the_same_figures(drawn: list[Path], tmp_path: Path) -> None:
    again = figures.write_figures(panel_of("full"), tmp_path)
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in drawn]


@pytest.mark.parametrize("name", ["given", "nothing learned", "none", "hostile"])
def test_figures_take_whatever_a_panel_lacks(name: str, tmp_path: Path) -> None:
    written = figures.write_figures(panel_of(name), tmp_path)
    expected = {
        "given": ["success_matrix.png", "energy_residual.png", "refinement_ladder.png"],
        "nothing learned": ["success_matrix.png", "energy_residual.png", "refinement_ladder.png"],
        "none": ["transfer_gaps.png"],
        "hostile": ALL_FIGURES,
    }
    assert [path.name for path in written] == expected[name]


def test_figures_of_an_earlier_panel_do_not_stay(tmp_path: Path) -> None:
    stale = tmp_path / "transfer_gaps.png"
    stale.write_bytes(b"old")
    (tmp_path / "mine.png").write_bytes(b"mine")
    figures.write_figures(panel_of("given"), tmp_path)
    assert not stale.exists()
    assert (tmp_path / "mine.png").exists()


@pytest.mark.slow
def test_figures_of_a_large_panel(tmp_path: Path) -> None:
    written = figures.write_figures(panel_of("large"), tmp_path)
    assert len(written) == 4


def test_neither_needs_more_than_its_own_package(tmp_path: Path) -> None:
    code = (
        "import sys; import integ_gym.eval.report, integ_gym.eval.figures; "
        "assert not {'matplotlib', 'jinja2'} & set(sys.modules); "
        "from matplotlib import rcParams; import integ_gym.eval.figures as f; "
        "f.write_figures({'schema_version': 1}, '.'); "
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60, cwd=tmp_path)


# In a browser -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_pages_fit_a_desktop_and_a_phone(tmp_path: Path) -> None:
    pages = {name: report.render(panel_of(name)) for name in PANELS}
    assert_fits(tmp_path, pages)


@pytest.mark.slow
def test_a_link_to_a_cell_opens_its_record(tmp_path: Path) -> None:
    path = report.write_report(panel_of("full"), tmp_path)
    run = browser(tmp_path, "--dump-dom", f"{path.as_uri()}#r1c2")
    assert complaints(run) == []
    page = run.stdout.split('id="records"')[1]
    opened = page[: page.index('id="r1c2"')].rsplit("<details", 1)[1]
    assert opened.startswith(' class="card" open=')
    assert page.count("<button") > 100


@pytest.mark.slow
@pytest.mark.parametrize("scheme", [0, 1], ids=["dark", "light"])
def test_the_page_is_drawn_in_both_schemes(scheme: int, tmp_path: Path) -> None:
    path = report.write_report(panel_of("full"), tmp_path)
    shot = tmp_path / "shot.png"
    colours = f"--blink-settings=preferredColorScheme={scheme}"
    window = ("--window-size=1280,1800", f"--screenshot={shot}", colours)
    run = browser(tmp_path, *window, path.as_uri())
    assert complaints(run) == []
    image = pixels(shot)
    assert image.shape[:2] == (1800, 1280)
    page = image[5, 5].mean()
    assert page < 0.2 if scheme == 0 else page > 0.8
    assert np.any(np.abs(image - image[5, 5]) > 0.1, axis=-1).mean() > 0.05
