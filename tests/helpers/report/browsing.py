"""Pages in a browser without a window."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--hide-scrollbars",
    "--enable-logging=stderr", "--virtual-time-budget=8000",
)  # fmt: skip
MEASURE = """<script>
(function () {
  var root = document.documentElement, errors = 0;
  addEventListener("error", function () { errors += 1; });
  addEventListener("load", function () {
    parent.postMessage([NAME, innerWidth, root.scrollWidth, errors].join("|"), "*");
  });
})();
</script>"""


def program() -> str:
    """Path of a browser; without one a test is skipped, and fails in CI."""
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        if os.environ.get("CI"):
            pytest.fail(f"none of {', '.join(BROWSERS)} is installed")
        pytest.skip(f"none of {', '.join(BROWSERS)} is installed")
    return found


def browser(directory: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a browser without a window and with a fresh profile."""
    profile = f"--user-data-dir={directory / 'profile'}"
    command = [program(), *FLAGS, profile, *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, encoding="utf-8", timeout=120, check=True
    )


def complaints(run: subprocess.CompletedProcess[str]) -> list[str]:
    """What a page wrote to the console, errors among it."""
    return [line for line in run.stderr.splitlines() if "CONSOLE" in line]


def assert_fits(directory: Path, pages: Mapping[str, str]) -> None:
    """No page is wider than a desktop or a phone, or writes to the console.

    Frames are as wide as the screens, because a window cannot be made as narrow as a phone.
    """
    widths, frames = (1280, 390), []
    for number, html in enumerate(pages.values()):
        open_to_all = re.sub(r"<meta http-equiv[^>]*>", "", html)
        script = MEASURE.replace("NAME", f"'{number}'")
        measured = open_to_all.replace("<head>", "<head>" + script)
        (directory / f"{number}.html").write_text(measured, "utf-8")
        frames += [
            f'<iframe src="{number}.html" width="{w}" height="800"></iframe>' for w in widths
        ]
    listen = (
        '<script>addEventListener("message", function (event) {'
        'document.title += event.data + ";"; });</script>'
    )
    wrapper = directory / "frames.html"
    style = "<style>iframe { border: 0; display: block; }</style>"
    wrapper.write_text(f"<!DOCTYPE html><title></title>{style}{listen}{''.join(frames)}", "utf-8")
    run = browser(directory, "--window-size=1300,900", "--dump-dom", wrapper.as_uri())
    title = re.search(r"<title>(.*?)</title>", run.stdout)
    assert title is not None
    found = sorted(line.split("|") for line in title[1].split(";") if line)
    assert len(found) == len(pages) * len(widths)
    for page, inner, scrolled, errors in found:
        assert int(inner) in widths
        assert int(scrolled) <= int(inner), list(pages)[int(page)]
        assert int(errors) == 0
    assert complaints(run) == []
