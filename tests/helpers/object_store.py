"""An S3-compatible server on loopback, in a process of its own, with a bucket in it."""

from __future__ import annotations

import os
import subprocess
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MOTO = Path(__file__).resolve().parents[2] / ".moto" / "bin" / "python"
"""Interpreter that has moto, as ``make moto`` sets it up."""

SERVING = Path(__file__).with_name("serving_s3.py")
BUCKET = "s3://bucket"


@contextmanager
def served_bucket() -> Iterator[dict[str, str]]:
    """A server with an empty bucket; what the environment tells of it."""
    assert MOTO.is_file(), "run `make moto`, as `make test-slow` does"
    command = [str(MOTO), "-W", "ignore", str(SERVING)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as server:
        try:
            endpoint = f"http://127.0.0.1:{int(server.stdout.readline())}"
            made = urllib.request.Request(f"{endpoint}/bucket", method="PUT")
            urllib.request.urlopen(made).close()
            yield {
                "AWS_ENDPOINT_URL": endpoint,
                "AWS_ACCESS_KEY_ID": "test",
                "AWS_SECRET_ACCESS_KEY": "test",
                "AWS_REGION": "us-east-1",
            }
        finally:
            server.kill()


@contextmanager
def environment(told: dict[str, str]) -> Iterator[None]:
    """This process's environment with more in it, as processes that it starts see it too."""
    before = {name: os.environ.get(name) for name in told}
    os.environ.update(told)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name)
            else:
                os.environ[name] = value
