"""A Hugging Face Hub on loopback: as much of it as its library asks for to push and to read."""

from __future__ import annotations

import base64
import json
import re
import threading
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import unquote, urlsplit

SHA = "a" * 40


class LoopbackHub(ThreadingHTTPServer):
    """Holds ``files[kind, repo]``, name to content, and the tokens that pushes came with."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.files: dict[tuple[str, str], dict[str, bytes]] = defaultdict(dict)
        self.tokens: set[str | None] = set()

    @property
    def told(self) -> dict[str, str]:
        return {"HF_ENDPOINT": f"http://127.0.0.1:{self.server_port}", "HF_HUB_DISABLE_XET": "1"}


class _Handler(BaseHTTPRequestHandler):
    server: LoopbackHub

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.tokens.add(self.headers["Authorization"])
        path = urlsplit(self.path).path
        if path == "/api/repos/create":
            asked = json.loads(body)
            repo = f"{asked['organization']}/{asked['name']}"
            kind = asked.get("type", "model")
            self.server.files[kind, repo].clear()
            return self._answer({"url": f"{self.server.told['HF_ENDPOINT']}/{repo}"})
        if path == "/api/validate-yaml":
            assert json.loads(body)["content"].startswith("---\n")
            return self._answer({"warnings": [], "errors": []})
        kind, repo, verb = re.fullmatch(
            r"/api/(\w+)s/(.+/.+)/(preupload|commit)/main", path
        ).groups()
        if verb == "preupload":
            modes = [
                {"path": one["path"], "uploadMode": "regular", "shouldIgnore": False}
                for one in json.loads(body)["files"]
            ]
            return self._answer({"files": modes})
        for line in body.splitlines():
            operation = json.loads(line)
            if operation["key"] == "file":
                one = operation["value"]
                self.server.files[kind, repo][one["path"]] = base64.b64decode(one["content"])
        url = f"{self.server.told['HF_ENDPOINT']}/{repo}/commit/{SHA}"
        return self._answer({"commitOid": SHA, "commitUrl": url, "success": True})

    def do_HEAD(self) -> None:
        self.do_GET()

    def do_GET(self) -> None:
        path = unquote(urlsplit(self.path).path)
        if found := re.fullmatch(r"/api/models/([^/]+/[^/]+)(?:/(tree|revision)/.+)?", path):
            files = self.server.files.get(("model", found[1]))
            if files is None:
                return self._answer({"error": "no such repository"}, 404)
            if found[2] == "tree":
                return self._answer(
                    [{"type": "file", "path": name, "size": len(own), "oid": SHA}
                     for name, own in files.items()]
                )  # fmt: skip
            siblings = [{"rfilename": name} for name in files]
            return self._answer({"id": found[1], "sha": SHA, "siblings": siblings})
        if found := re.fullmatch(r"/([^/]+/[^/]+)/resolve/[^/]+/(.+)", path):
            return self._send(self.server.files["model", found[1]][found[2]])
        return self._answer({"error": "it is not needed"}, 404)

    def _answer(self, content: Any, code: int = 200) -> None:
        self._send(json.dumps(content).encode(), code, "application/json")

    def _send(
        self, content: bytes, code: int = 200, kind: str = "application/octet-stream"
    ) -> None:
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("ETag", f'"{hash(content) & 0xFFFFFFFF:040x}"')
        self.send_header("X-Repo-Commit", SHA)
        if code == 404:
            self.send_header("X-Error-Code", "RepoNotFound")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:
        pass


@contextmanager
def loopback_hub() -> Iterator[LoopbackHub]:
    """A Hub without any repository."""
    with LoopbackHub() as hub:
        thread = threading.Thread(target=hub.serve_forever, daemon=True)
        thread.start()
        try:
            yield hub
        finally:
            hub.shutdown()
            thread.join()
