"""The page is served on loopback to whoever knows its address, and can ask for nothing beyond it."""

import http.client
import json
import re
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from cli.viewer.board import Board
from cli.viewer.server import PAGE, ViewServer, page_file
from messages import UserError

OWN = [name for name in PAGE if not name.startswith("uPlot")]
ELSEWHERE = re.compile(r"""["'(=\s](?:[a-z]+:)?//[^\s"')]+""")
ASKS = (
    "fetch(",
    "XMLHttpRequest",
    "importScripts",
    "import(",
    "sendBeacon",
    "EventSource",
    "WebSocket(",
    "url(",
    "@import",
)
"""What a script or a style sheet could load something with."""


class Opened:
    """A server with its board and what was said to it."""

    def __init__(self) -> None:
        self.board = Board("walk")
        self.commands: list[str] = []
        self.server = ViewServer(self.board, 0, self.commands.append)
        self.url = urlsplit(self.server.url)

    def get(self, path: str, host: str | None = None) -> http.client.HTTPResponse:
        assert self.url.hostname is not None
        connection = http.client.HTTPConnection(self.url.hostname, self.url.port, timeout=20.0)
        connection.request("GET", path, headers={"Host": host or self.url.netloc})
        return connection.getresponse()


@pytest.fixture
def opened() -> Iterator[Opened]:
    opened = Opened()
    with opened.server:
        yield opened


def test_all_files_of_the_page_come_under_a_policy_that_names_this_server_alone(opened: Opened) -> None:
    for name in ("", *PAGE):
        answer = opened.get(opened.url.path + name)
        assert answer.status == 200
        assert answer.read() == page_file(name or "index.html")
        rules = dict(rule.strip().partition(" ")[::2] for rule in answer.headers["Content-Security-Policy"].split(";"))
        assert rules["default-src"] == "'self'"
        port = opened.url.port
        assert rules["connect-src"] == f"'self' ws://127.0.0.1:{port} ws://localhost:{port}"
        assert set(rules) == {"default-src", "connect-src", "base-uri", "form-action", "frame-ancestors"}
        assert {rules[name] for name in ("base-uri", "form-action", "frame-ancestors")} == {"'none'"}


def test_it_listens_on_loopback_alone(opened: Opened) -> None:
    assert opened.url.hostname == "127.0.0.1"
    assert opened.server.address[0] == "127.0.0.1"


@pytest.mark.parametrize("name", OWN)
def test_no_file_of_the_page_names_another_server(name: str) -> None:
    text = page_file(name).decode().replace('xmlns="http://www.w3.org/2000/svg"', "")
    assert ELSEWHERE.findall(text) == []


def test_the_plotting_library_loads_nothing_and_its_licence_is_beside_it() -> None:
    script, style = page_file("uPlot.iife.min.js").decode(), page_file("uPlot.min.css").decode()
    assert [word for word in ASKS if word in script or word in style] == []
    assert "MIT License" in page_file("uPlot-LICENSE").decode()


@pytest.mark.parametrize(
    "path", ["/", "/index.html", "/guess/", "{secret}x/", "{secret}/../x", "{secret}/uPlot-LICENSE"]
)
def test_without_the_secret_or_the_name_of_a_file_there_is_nothing(opened: Opened, path: str) -> None:
    assert opened.get(path.format(secret=opened.url.path.rstrip("/"))).status == 404


def test_a_name_of_the_internet_that_leads_here_gets_nothing(opened: Opened) -> None:
    assert opened.get(opened.url.path, host=f"evil.example:{opened.url.port}").status == 404


def test_another_page_cannot_read_the_data(opened: Opened) -> None:
    for origin in (Origin("http://evil.example"), None):
        with pytest.raises(InvalidStatus) as refused, connect(_data(opened), origin=origin):
            pass
        assert refused.value.response.status_code == 403


def test_the_data_come_as_text_and_pictures_and_commands_go_back(opened: Opened) -> None:
    opened.board.add_point((0.0, 1.5))
    opened.board.set_picture(b"picture")
    with connect(_data(opened), origin=Origin(f"http://{opened.url.netloc}")) as browser:
        assert json.loads(browser.recv(timeout=20.0))["points"] == [[0.0, 1.5]]
        assert browser.recv(timeout=20.0) == b"picture"
        browser.send("pause")
        for _ in range(40):
            browser.recv(timeout=20.0)
            if opened.commands:
                break
        assert opened.commands == ["pause"]
        browser.send("x" * 1000)
        with pytest.raises(ConnectionClosed):
            list(iter(lambda: browser.recv(timeout=20.0), None))


def test_a_port_that_is_taken_is_told_in_one_line(opened: Opened) -> None:
    with pytest.raises(UserError, match=f"--port {opened.url.port}: .*in use"):
        ViewServer(Board("other"), opened.url.port or 0, lambda _said: None)


def _data(opened: Opened) -> str:
    return f"ws://{opened.url.netloc}{opened.url.path}data"
