"""The page and its data on a port of the loopback interface, for who knows the address that was printed.

The address holds a secret drawn anew at each start: other users of this machine may reach the port, not the page. What
the browser may load is told in Content-Security-Policy: this server's own files, nothing else. Host and Origin are
checked, so that no page of the internet can read from it by a name that leads here.
"""

import http
import logging
import secrets
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from importlib.resources import files
from types import TracebackType

from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import Server, ServerConnection, serve

from cli.viewer.board import NOTHING_YET, Board
from messages import UserError

HOST = "127.0.0.1"
LEAST_APART_S = 0.05
"""Of two messages to a browser."""
HEARTBEAT_S = 0.5
LONGEST_COMMAND_BYTES = 64

_TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
PAGE = ("index.html", "view.js", "view.css", "icon.svg", "uPlot.iife.min.js", "uPlot.min.css")
"""The files that the browser gets; uPlot-LICENSE is that of the last two."""


class ViewServer:
    """Serves the page of `board` until the end of a `with` block; `command` is told what its buttons say.

    `port` 0 takes any. Raises UserError, in one line, where the port is taken.
    """

    def __init__(self, board: Board, port: int, command: Callable[[str], None]) -> None:
        self._board = board
        self._command = command
        self._secret = secrets.token_urlsafe(16)
        self._seen = threading.Event()
        try:
            self._server: Server = serve(
                self._talk,
                HOST,
                port,
                process_request=self._answer,
                compression=None,
                max_size=LONGEST_COMMAND_BYTES,
                logger=_quiet(),
            )
        except OSError as error:
            raise UserError(f"--port {port}: {error.strerror}; another view may be open, 0 takes any port") from error
        _, self._port = self.address
        self._thread = threading.Thread(target=self._server.serve_forever, name="view-server", daemon=True)

    @property
    def url(self) -> str:
        """Return the address of the page."""
        return f"http://{HOST}:{self._port}/{self._secret}/"

    @property
    def address(self) -> tuple[str, int]:
        """Return where it listens."""
        host, port = self._server.socket.getsockname()
        return host, port

    def wait_for_a_browser(self) -> None:
        """Return once somebody looks."""
        while not self._seen.wait(0.2):
            pass

    def __enter__(self) -> "ViewServer":
        self._thread.start()
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _traceback: TracebackType | None
    ) -> None:
        self._board.close()
        self._server.shutdown()
        self._thread.join()

    @property
    def _hosts(self) -> tuple[str, ...]:
        return f"{HOST}:{self._port}", f"localhost:{self._port}"

    def _answer(self, _connection: ServerConnection, request: Request) -> Response | None:
        """Return a file of the page, or None for the WebSocket."""
        host = request.headers.get("Host", "")
        prefix, _, name = request.path.rpartition("/")
        if host not in self._hosts or not secrets.compare_digest(prefix.encode(), f"/{self._secret}".encode()):
            return self._response(http.HTTPStatus.NOT_FOUND, "text/plain", b"the address is the one that was printed\n")
        if name == "data":
            own = request.headers.get("Origin") == f"http://{host}"
            return None if own else self._response(http.HTTPStatus.FORBIDDEN, "text/plain", b"of another page\n")
        name = name or "index.html"
        if name not in PAGE:
            return self._response(http.HTTPStatus.NOT_FOUND, "text/plain", b"no such file\n")
        kind = _TYPES[name[name.rindex(".") :]]
        return self._response(http.HTTPStatus.OK, f"{kind}; charset=utf-8", page_file(name))

    def _response(self, status: http.HTTPStatus, kind: str, body: bytes) -> Response:
        headers = Headers(
            {
                "Content-Type": kind,
                "Content-Length": str(len(body)),
                "Content-Security-Policy": policy(self._hosts),
                "Cache-Control": "no-store",
                "Connection": "close",
                "Cross-Origin-Resource-Policy": "same-origin",
                "Referrer-Policy": "no-referrer",
                "X-Content-Type-Options": "nosniff",
            }
        )
        return Response(status.value, status.phrase, headers, body)

    def _talk(self, connection: ServerConnection) -> None:
        """Send one browser what is new, until it goes."""
        self._seen.set()
        known = NOTHING_YET
        try:
            while (news := self._board.news(known, HEARTBEAT_S)) is not None:
                connection.send(news.text.decode())
                if news.jpeg is not None:
                    connection.send(news.jpeg)
                known = news
                self._listen(connection)
        except ConnectionClosed:
            return

    def _listen(self, connection: ServerConnection) -> None:
        end_s = time.monotonic() + LEAST_APART_S
        with suppress(TimeoutError):
            while (left_s := end_s - time.monotonic()) > 0.0:
                self._command(str(connection.recv(timeout=left_s)))


def page_file(name: str) -> bytes:
    """Return a file of the page as it is shipped."""
    return (files("cli.viewer") / "page" / name).read_bytes()


def policy(hosts: tuple[str, ...]) -> str:
    """Return what the page may load, and from where: its own files, its data from `hosts`, this server."""
    sockets = " ".join(f"ws://{host}" for host in hosts)
    return (
        f"default-src 'self'; connect-src 'self' {sockets}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )


def _quiet() -> logging.Logger:
    """Return a logger for what any stranger at the port can cause."""
    logger = logging.getLogger("gaiteyes.view")
    logger.setLevel(logging.CRITICAL)
    return logger
