"""The server of the viewer's page, for browsers of this machine only."""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import sys
import tempfile
import threading
from _thread import LockType
from collections.abc import Iterator, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl

import numpy as np

from ..errors import InputError
from ..tools import checked
from ..trajectory.reader import Trajectory
from .content import Content, pack
from .page import blank, policy

if TYPE_CHECKING:
    from .points import StudyPoints

TEXT, JSON, BYTES = "text/plain; charset=utf-8", "application/json", "application/octet-stream"


class Server(ThreadingHTTPServer):
    """Server of the page and its data, at an address of this machine with a random token.

    Requests without the token, or for another host's name (as by DNS rebinding), are refused with status 403.

    Parameters
    ----------
    content : Content or StudyPoints
        A trajectory, or the points of a study.
    port : int
        0: any free one.

    Raises
    ------
    OSError
        If the port is taken.
    """

    daemon_threads = True

    def __init__(self, content: Content | StudyPoints, port: int = 0) -> None:
        self.token: str = secrets.token_urlsafe(24)
        self.lock: LockType = threading.Lock()  # HDF5 is read by one thread at a time
        self.page: bytes = blank().encode()
        self._points = None if isinstance(content, Content) else content
        self._run, self._content = "", content if isinstance(content, Content) else None
        super().__init__(("127.0.0.1", port), _Handler)

    @property
    def address(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.server_port}/{self.token}/"

    @contextlib.contextmanager
    def redirecting_file(self) -> Iterator[Path]:
        """A page that leads to the address, in a file that only this user can read; removed at the end."""
        with tempfile.TemporaryDirectory(prefix="ifrdem-view-") as folder:  # of mode 0700
            path = Path(folder, "view.html")
            with open(
                os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600), "w", encoding="utf-8"
            ) as file:
                file.write(
                    f'<!DOCTYPE html><meta charset="utf-8"><meta name="referrer" content="no-referrer">'
                    f'<meta http-equiv="refresh" content="0; url={self.address}"><title>ifrdem</title>'
                    f'<a href="{self.address}">to the page</a>\n'
                )
            yield path

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore browsers that close the connection during an answer."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)

    def answer(self, name: str, query: Mapping[str, str]) -> tuple[str, bytes] | None:
        """Type and bytes of an answer, by the last part of its path; None if there is nothing of that name.

        Raises InputError if the query names something that does not exist.
        """
        if name == "":
            return "text/html; charset=utf-8", self.page
        if name not in ("head", "disks", "frame", "disk", "point"):
            return None
        if name == "point" and self._points is None:
            raise InputError(
                "point: a trajectory is shown here; `ifrdem view --study` shows the points of a study"
            )
        with self.lock:
            if self._points is not None and name == "point":
                return JSON, _json(self._points.point(_number(query, "point")))
            if self._points is not None and name == "head" and "run" not in query:
                return JSON, _json(self._points.head())
            content = self._of_run(query.get("run", ""))
            if name == "head":
                content.refresh()
                known = _number(query, "frames", -1), query.get("gas")
                news = known != (len(content.trajectory), content.gas)
                return JSON, _json(content.head() if news else {"status": content.status})
            if name == "disks":
                return BYTES, content.disks()
            frame = _number(query, "frame")
            if name == "disk":
                return JSON, _json(content.disk(_number(query, "id"), frame))
            colours = [query["colour"]] if query.get("colour") else []
            for one in colours:
                checked.choice("colour", one, [each["name"] for each in content.colours[0]])
            return BYTES, pack(*content.frame(frame, colours, _window(query.get("window"))))

    def _of_run(self, run: str) -> Content:
        """The trajectory, or that of a run of the study."""
        if self._content is None or run != self._run:
            if self._points is None:
                raise InputError(f"run = {run}: this is not a study")
            self._content, self._run = Content(Trajectory(self._points.trajectory(run))), run
        return self._content


def _json(value: Any) -> bytes:
    return json.dumps(value, allow_nan=False).encode()


def _number(query: Mapping[str, str], name: str, least: int = 0) -> int:
    found: int = checked.Integer(least).of_text(name, query.get(name, str(least) if least < 0 else ""))
    return found


def _window(text: str | None) -> np.ndarray | None:
    """Ends of x and of y from "x0,x1,y0,y1"."""
    if text is None:
        return None
    try:
        ends = np.array([float(one) for one in text.split(",")]).reshape(2, 2)
    except ValueError:
        ends = np.full((2, 2), np.nan)
    if not (np.isfinite(ends).all() and (ends[:, 0] < ends[:, 1]).all()):
        raise InputError(f"window = {text}: must be x0,x1,y0,y1, ascending")
    return ends


class _Handler(BaseHTTPRequestHandler):
    server: Server
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "ifrdem", ""
    timeout = 60.0  # of a connection without requests [s]
    wbufsize, disable_nagle_algorithm = -1, True  # an answer leaves at once, in one piece

    def parse_request(self) -> bool:
        """Read a request; one for another host, or without the token, is refused before its method is read."""
        if not super().parse_request():
            return False
        # What follows a body that is not read would be taken for the next request.
        lengths = self.headers.get_all("Content-Length", [])
        if (
            any(one.strip() != "0" for one in lengths)
            or "Transfer-Encoding" in self.headers
            or self.headers.defects
        ):
            self.close_connection = True
        hosts = {f"{name}:{self.server.server_port}" for name in ("127.0.0.1", "localhost")}
        token = self.path.partition("?")[0].strip("/").partition("/")[0]
        known = secrets.compare_digest(token.encode(), self.server.token.encode())
        if known and self.headers.get("Host") in hosts:
            return True
        self.close_connection = True
        self._send(
            HTTPStatus.FORBIDDEN, TEXT, b"use the address that `ifrdem view` printed, with its token\n"
        )
        return False

    def do_GET(self) -> None:
        """Answer a request."""
        path, _, query = self.path.partition("?")
        try:
            name = path.partition(self.server.token)[2].strip("/")
            found = self.server.answer(name, dict(parse_qsl(query)))
        except InputError as error:
            self._send(HTTPStatus.BAD_REQUEST, TEXT, f"{error}\n".encode())
            return
        if found is None:
            self._send(HTTPStatus.NOT_FOUND, TEXT, b"there is no such page\n")
        else:
            self._send(HTTPStatus.OK, *found)

    def _send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.send_response(status)
        for name, value in {
            "Content-Type": kind, "Content-Length": str(len(body)), "Cache-Control": "no-store",
            "Content-Security-Policy": policy("'self'"), "X-Content-Type-Options": "nosniff",
            "X-Frame-Options": "DENY", "Referrer-Policy": "no-referrer", "Cross-Origin-Resource-Policy": "same-origin",
        }.items():  # fmt: skip
            self.send_header(name, value)
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing: addresses hold the token."""
