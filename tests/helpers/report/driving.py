"""A browser without a window that is told what to do: keys, sizes, schemes, scripts, pictures.

It is spoken to in the Chrome DevTools Protocol, through a pair of pipes.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--hide-scrollbars",
    "--remote-debugging-pipe", "--window-size=1440,900", "--allow-file-access-from-files",
)  # fmt: skip
KEYS = {"Enter": 13, "Escape": 27, "Tab": 9, "ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39,
        "ArrowDown": 40, "Home": 36, "End": 35, " ": 32}  # fmt: skip
PATIENCE = 30.0  # s


class Browser:
    """One page at a time.

    Attributes:
        said: what pages wrote to the console, and what they raised.
        asked: addresses that pages asked for.
    """

    def __init__(self, read: int, write: int) -> None:
        self._in, self._out = os.fdopen(read, "rb", 0), os.fdopen(write, "wb", 0)
        self._held, self._count, self._session = b"", 0, ""
        self._loaded = False
        self.said: list[str] = []
        self.asked: list[str] = []
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        attached = self._call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self._call(f"{domain}.enable")
        self._call("Emulation.setFocusEmulationEnabled", enabled=True)

    def close(self) -> None:
        """Let go of the pipes."""
        self._in.close()
        self._out.close()

    def open(self, address: str) -> None:
        """Load a page, and wait until it is."""
        self._call("Page.navigate", url="about:blank")
        self._loaded = False
        self._call("Page.navigate", url=address)
        self.until("document.readyState === 'complete' && location.href !== 'about:blank'")

    def open_report(self, address: str) -> None:
        """Load a panel's page, and wait until its script is done."""
        self.open(address)
        self.until("'ready' in document.documentElement.dataset")

    def size(self, width: int, height: int, phone: bool = False) -> None:
        """The window's size in pixels."""
        self._call("Emulation.setDeviceMetricsOverride", width=width, height=height,
                   deviceScaleFactor=1, mobile=phone)  # fmt: skip

    def prefers(self, **features: str) -> None:
        """What the reader prefers: ``color_scheme="dark"``, ``reduced_motion="reduce"``."""
        told = [
            {"name": f"prefers-{name.replace('_', '-')}", "value": value}
            for name, value in features.items()
        ]
        self._call("Emulation.setEmulatedMedia", features=told)

    def forces_colours(self) -> None:
        """The reader has colours forced, as with high contrast."""
        told = [{"name": "forced-colors", "value": "active"}]
        self._call("Emulation.setEmulatedMedia", features=told)

    def value(self, script: str) -> Any:
        """Value of an expression, promises awaited.

        Raises:
            AssertionError: with what the script raised.
        """
        found = self._call(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def until(self, script: str) -> None:
        """Wait until an expression holds."""
        end = time.monotonic() + PATIENCE
        while not self.value(script):
            assert time.monotonic() < end, f"never held: {script}"
            time.sleep(0.02)

    def press(self, *keys: str) -> None:
        """Press keys, one after the other; ``Shift+Tab`` is one."""
        for key in keys:
            name = key.removeprefix("Shift+")
            told: dict[str, Any] = {
                "key": name, "code": name, "windowsVirtualKeyCode": KEYS[name],
                "modifiers": 8 if name != key else 0,
            }  # fmt: skip
            text = {"Enter": "\r", " ": " "}.get(name)
            down = {"type": "keyDown", "text": text} if text else {"type": "rawKeyDown"}
            self._call("Input.dispatchKeyEvent", **told, **down)
            self._call("Input.dispatchKeyEvent", **told, type="keyUp")

    def picture(self, path: Path, whole: bool = False) -> None:
        """Write what is seen, or the whole page, as PNG."""
        more = {"captureBeyondViewport": True} if whole else {}
        found = self._call("Page.captureScreenshot", format="png", **more)
        path.write_bytes(base64.b64decode(found["data"]))

    def _call(self, method: str, **told: Any) -> dict[str, Any]:
        self._count += 1
        message: dict[str, Any] = {"id": self._count, "method": method, "params": told}
        if self._session:
            message["sessionId"] = self._session
        self._out.write(json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._count:
                assert "error" not in answer, answer["error"]
                return answer.get("result", {})
            self._note(answer)

    def _note(self, event: Mapping[str, Any]) -> None:
        method, told = event.get("method"), event.get("params", {})
        if method == "Runtime.consoleAPICalled":
            self.said.append(str(told["args"]))
        elif method == "Runtime.exceptionThrown":
            self.said.append(str(told["exceptionDetails"]))
        elif method == "Log.entryAdded":
            self.said.append(str(told["entry"]))
        elif method == "Network.requestWillBeSent":
            self.asked.append(told["request"]["url"])

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._held:
            more = self._in.read(1 << 16)
            assert more, "the browser is gone"
            self._held += more
        message, _, self._held = self._held.partition(b"\0")
        return json.loads(message)


@contextlib.contextmanager
def driven(directory: Path) -> Iterator[Browser]:
    """A browser with a fresh profile in a directory."""
    to_read, from_browser = os.pipe()
    to_browser, to_write = os.pipe()
    program = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if program is None:
        missing = f"none of {', '.join(BROWSERS)} is installed"
        pytest.fail(missing) if os.environ.get("CI") else pytest.skip(missing)
    command = [program, *FLAGS, f"--user-data-dir={directory / 'driven'}"]
    shell = f'exec "$@" 3<&{to_browser} 4>&{from_browser}'
    process = subprocess.Popen(
        ["bash", "-c", shell, "browser", *command],
        pass_fds=(to_browser, from_browser), stderr=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(to_browser)
    os.close(from_browser)
    try:
        with contextlib.closing(Browser(to_read, to_write)) as browser:
            yield browser
    finally:
        process.terminate()
        process.wait(timeout=PATIENCE)


def assert_fits(directory: Path, pages: Mapping[str, str]) -> None:
    """No page is wider than a desktop or a phone, or writes to the console."""
    with driven(directory) as browser:
        for name, html in pages.items():
            (directory / "page.html").write_text(html, "utf-8")
            for width in (1280, 390):
                browser.size(width, 800, phone=width < 500)
                browser.open((directory / "page.html").as_uri())
                widths = browser.value("[innerWidth, document.documentElement.scrollWidth]")
                assert widths[1] <= widths[0] == width, name
        assert browser.said == []
