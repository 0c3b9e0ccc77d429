"""Shared test set-up."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import pytest

from integ_gym.envs.engines import ENGINES, missing_modules
from integ_gym.eval.census.published import PUBLISHED, installed


def pytest_addoption(parser: pytest.Parser) -> None:
    """``--no-skip``, for machines on which everything is installed."""
    parser.addoption("--no-skip", action="store_true", help="a test that is skipped fails")


def pytest_configure() -> None:
    """Tables are printed in full where no test says how wide the terminal is."""
    os.environ.pop("COLUMNS", None)


def pytest_report_header() -> str:
    """What is not tested here."""
    absent = [name for name in ENGINES.names() if missing_modules(name)]
    absent += [name for name in PUBLISHED.names() if not installed(name)]
    return f"not installed, and so not tested: {', '.join(absent) or 'nothing'}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    """With ``--no-skip``, a skipped test fails with the reason for which it was skipped."""
    report: Any = yield
    if report.skipped and item.config.getoption("--no-skip"):
        report.outcome = "failed"
        report.longrepr = f"skipped: {report.longrepr}"
    return report
