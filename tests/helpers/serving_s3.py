"""moto's S3 over HTTP on loopback, run by the interpreter of its own environment.

One request at a time is answered: moto looks for an object and makes it in two steps, between which
another thread may make it, which no store does that honours a conditional put. The first line on
standard output is the port.
"""

from __future__ import annotations

import threading
from typing import Any

from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app
from werkzeug.serving import make_server


class OneAtATime:
    """Answers one request after the other."""

    def __init__(self) -> None:
        self._application: Any = DomainDispatcherApplication(create_backend_app)
        self._turn = threading.Lock()

    def __call__(self, environ: dict[str, Any], start_response: Any) -> list[bytes]:
        """Answer a request."""
        with self._turn:
            return [b"".join(self._application(environ, start_response))]


def main() -> None:
    """Serve until the process is ended."""
    server = make_server("127.0.0.1", 0, OneAtATime(), threaded=True)
    print(server.port, flush=True)
    server.serve_forever()


if __name__ == "__main__":
    main()
