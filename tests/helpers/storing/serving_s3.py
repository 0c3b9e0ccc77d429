"""moto's S3 over HTTP on loopback, run by the interpreter of its own environment.

    python serving_s3.py FAULT

One request at a time is answered: moto looks for an object and makes it in two steps, between which
another thread may make it, which no store does that honours a conditional put. The first line on
standard output is the port. `COUNTS` answers with how many requests of each kind there were.
"""

from __future__ import annotations

import json
import sys
import threading
from collections import Counter
from typing import Any

from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app
from werkzeug.serving import make_server

HIDDEN = {
    "none": (),
    "no If-None-Match": ("HTTP_IF_NONE_MATCH",),
    "no If-Match": ("HTTP_IF_MATCH",),
}
"""Headers of a PUT that the server does not heed, by fault."""

COUNTS = "/moto-counts"


class Served:
    """Answers one request after the other.

    Args:
        fault: of the store, a key of :data:`HIDDEN`.
    """

    def __init__(self, fault: str) -> None:
        self._application: Any = DomainDispatcherApplication(create_backend_app)
        self._hidden = HIDDEN[fault]
        self._turn = threading.Lock()
        self._counts: Counter[str] = Counter()

    def __call__(self, environ: dict[str, Any], start_response: Any) -> list[bytes]:
        """Answer a request."""
        if environ["PATH_INFO"] == COUNTS:
            start_response("200 OK", [("Content-Type", "application/json")])
            return [json.dumps(self._counts).encode()]
        if environ["REQUEST_METHOD"] == "PUT":
            for name in self._hidden:
                environ.pop(name, None)
        with self._turn:
            self._counts[_kind(environ)] += 1
            return [b"".join(self._application(environ, start_response))]


def _kind(environ: dict[str, Any]) -> str:
    method, listing = environ["REQUEST_METHOD"], "list-type" in environ["QUERY_STRING"]
    return "LIST" if listing else "COPY" if "HTTP_X_AMZ_COPY_SOURCE" in environ else method


def main() -> None:
    """Serve until the process is ended."""
    server = make_server("127.0.0.1", 0, Served(sys.argv[1]), threaded=True)
    print(server.port, flush=True)
    server.serve_forever()


if __name__ == "__main__":
    main()
