"""A project in the browser, from a server on this machine alone.

Every address has a token in its path, made anew for each run, so that other users and pages of this
machine find nothing; the Host header must name the loopback address, so that a foreign page cannot
reach the server under a name of its own (DNS rebinding). Nothing is written to the project and only
what is asked for is read, while `semsfm reconstruct` may be at work: files are written aside and
renamed, so that each is whole, and a surface of another model is left out until its own is there.
"""

from __future__ import annotations

import hmac
import json
import secrets
import threading
import webbrowser
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from semsfm_colmap.errors import InputError, SemSfmError, UsageError
from semsfm_colmap.io.layout import LOCK_FILE
from semsfm_colmap.metrology.sizes.options import MetrologyOptions
from semsfm_colmap.pipeline.project import open_project
from semsfm_colmap.pipeline.view_content import ProjectView
from semsfm_colmap.report.viewer.html import LIVE_POLICY, live_page

LOOPBACK = "127.0.0.1"
TOKEN_BYTES = 24
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": LIVE_POLICY,
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What a request gets."""

    body: bytes
    kind: str = "application/json"
    status: HTTPStatus = HTTPStatus.OK
    headers: Mapping[str, str] = field(default_factory=dict)


def view(
    project_path: Path | str,
    *,
    options: MetrologyOptions | None = None,
    open_browser: bool = True,
    say: Callable[[str], None] = print,
) -> None:
    """Show a project in the browser until it is interrupted.

    Parameters
    ----------
    project_path : the project folder; what is there is shown, and what comes while it is open
    options : what is known of the scale, for the budgets
    say : is given the address

    Raises
    ------
    UsageError
        There is no such folder, or it holds no project.

    """
    server = make_server(project_path, options)
    try:
        say(f"{server.address}  (Ctrl-C ends it)")
        if open_browser:
            threading.Thread(target=webbrowser.open, args=(server.address,), daemon=True).start()
        server.serve_forever(poll_interval=0.2)
    except KeyboardInterrupt:
        say("ended")
    finally:
        server.server_close()


def make_server(project_path: Path | str, options: MetrologyOptions | None = None) -> ViewServer:
    """A server that listens already, on a free port; `serve_forever` answers.

    Raises
    ------
    UsageError
        There is no such folder, or it holds no project.

    """
    project = open_project(project_path)
    marks = (project.record, project.path / LOCK_FILE, project.sparse)
    if not any(mark.exists() for mark in marks):
        raise UsageError(
            f"{project.path} holds no project: give the folder that `semsfm reconstruct` was given "
            "as --output_path"
        )
    return ViewServer(ProjectView(project, options or MetrologyOptions()))


class ViewServer(ThreadingHTTPServer):
    """Serves one project to who knows its token."""

    daemon_threads = True

    def __init__(self, content: ProjectView) -> None:
        super().__init__((LOOPBACK, 0), Handler)
        self.content = content
        self.token = secrets.token_urlsafe(TOKEN_BYTES)

    @property
    def address(self) -> str:
        """What to open in a browser."""
        return f"http://{LOOPBACK}:{self.server_port}/{self.token}/"

    def allows(self, host: str | None, path: str) -> bool:
        """Whether a request names this machine and knows the token."""
        named = host in {f"{name}:{self.server_port}" for name in (LOOPBACK, "localhost")}
        token = path.lstrip("/").split("/", 1)[0]
        return named and hmac.compare_digest(token.encode(), self.token.encode())

    def answer(self, path: str, query: Mapping[str, list[str]]) -> Answer:
        """What a path below the token gets."""
        content = self.content
        if path == "":
            return Answer(body=live_page(content.title).encode(), kind="text/html; charset=utf-8")
        if path == "state":
            return _json({"stamp": content.stamp()})
        if path == "scene.bin":
            scene = content.scene()
            headers = {"X-Stamp": scene.stamp, "X-Remark": _header_text(scene.remark)}
            return Answer(body=scene.packed, kind="application/octet-stream", headers=headers)
        if path == "image":
            return Answer(body=content.picture(_number(query, "number")), kind="image/png")
        if path == "measure":
            return _json(content.measure(_numbers(query, "vertices")))
        return _json({"error": "there is no such page"}, HTTPStatus.NOT_FOUND)


class Handler(BaseHTTPRequestHandler):
    """Checks a request, and answers it."""

    server: ViewServer
    server_version = "semsfm"
    sys_version = ""

    def do_GET(self) -> None:
        """Answer, or refuse what has not the token."""
        parts = urlsplit(self.path)
        if not self.server.allows(self.headers.get("Host"), parts.path):
            self._send(_json({"error": "the address lacks its token"}, HTTPStatus.FORBIDDEN))
            return
        below = parts.path.lstrip("/").split("/", 1)
        if len(below) == 1:
            place = {"Location": f"/{below[0]}/"}
            self._send(Answer(body=b"", status=HTTPStatus.MOVED_PERMANENTLY, headers=place))
            return
        try:
            self._send(self.server.answer(below[1], parse_qs(parts.query)))
        except SemSfmError as error:
            self._send(_json({"error": str(error)}, HTTPStatus.CONFLICT))

    def _send(self, answer: Answer) -> None:
        try:
            self.send_response(answer.status)
            self.send_header("Content-Type", answer.kind)
            self.send_header("Content-Length", str(len(answer.body)))
            for name, value in {**HEADERS, **answer.headers}.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(answer.body)
        except (BrokenPipeError, ConnectionResetError):
            self.close_connection = True  # the browser has gone elsewhere

    def log_message(self, format: str, *arguments: Any) -> None:  # noqa: A002 (its name there)
        """Say nothing: the token would stand in every line."""


def _json(content: Any, status: HTTPStatus = HTTPStatus.OK) -> Answer:
    return Answer(body=json.dumps(content, allow_nan=False).encode(), status=status)


def _header_text(words: str) -> str:
    """What may stand in a header: one line of ASCII."""
    return " ".join(words.encode("ascii", "replace").decode("ascii").split())


def _number(query: Mapping[str, list[str]], name: str) -> int:
    return _numbers(query, name)[0]


def _numbers(query: Mapping[str, list[str]], name: str) -> list[int]:
    try:
        return [int(word) for word in query[name][0].split(",")]
    except (KeyError, ValueError):
        raise InputError(f"{name} must be whole numbers with commas between them") from None
