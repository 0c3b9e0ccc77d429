"""The report in a browser."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from browsing import assert_fits, browser, complaints
from driving import driven
from report_pages import PANELS, panel_of, pixels

from integ_gym.eval.report.page import render, write_report


@pytest.mark.slow
def test_pages_fit_a_desktop_and_a_phone(tmp_path: Path) -> None:
    pages = {name: render(panel_of(name)) for name in PANELS}
    assert_fits(tmp_path, pages)


@pytest.mark.slow
def test_a_link_to_a_cell_opens_its_numbers(tmp_path: Path) -> None:
    path = write_report(panel_of("full"), tmp_path)
    run = browser(tmp_path, "--dump-dom", f"{path.as_uri()}#r1c2")
    assert complaints(run) == []
    drawer = run.stdout.split('<dialog id="drawer"')[1]
    assert "open=" in drawer.split(">")[0]
    assert "loss against home" in drawer
    assert "This page carries no episodes of this cell." in drawer


@pytest.mark.slow
@pytest.mark.parametrize("scheme", [0, 1], ids=["dark", "light"])
def test_the_page_is_drawn_in_both_schemes(scheme: int, tmp_path: Path) -> None:
    path = write_report(panel_of("full"), tmp_path)
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


@pytest.mark.slow
def test_the_page_is_readable_with_forced_colours(tmp_path: Path) -> None:
    """Cells have borders where their grounds are taken away; homes have wider ones."""
    path = write_report(panel_of("full"), tmp_path)
    width = "(e) => parseFloat(getComputedStyle(e).borderTopWidth)"
    with driven(tmp_path / "profile") as chromium:
        chromium.size(1280, 900)
        chromium.forces_colours()
        chromium.open(path.as_uri())
        assert chromium.value("matchMedia('(forced-colors: active)').matches")
        cells = "[...document.querySelectorAll('table.heat td > a:not(.home)')]"
        homes = "[...document.querySelectorAll('table.heat a.home')]"
        assert set(chromium.value(f"{cells}.map({width})")) == {1}
        assert set(chromium.value(f"{homes}.map({width})")) == {3}
        adjust = "getComputedStyle(document.querySelector('.ramp')).forcedColorAdjust"
        assert chromium.value(adjust) == "none"
