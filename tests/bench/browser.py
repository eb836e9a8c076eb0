"""A headless Chromium, driven over its DevTools protocol: what a page asks for, what it shows, a picture of it.

It resolves no name but this machine's, and says nothing of its own accord. Protocol: chromedevtools.github.io.
"""

import base64
import itertools
import json
import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from websockets.sync.client import ClientConnection, connect

PATIENCE_S = 120.0
NAMES = ("chromium", "chromium-browser", "google-chrome")


def chromium() -> str | None:
    """Return the path of a Chromium of this machine, if there is one."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


class Page:
    """One page. `requests` are the addresses that it asked for, WebSockets included."""

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection
        self._numbers = itertools.count(1)
        self.requests: list[str] = []
        self.errors: list[str] = []
        for domain in ("Page", "Network", "Runtime", "Log"):
            self._call(f"{domain}.enable")

    def open(self, url: str) -> None:
        self._call("Page.navigate", url=url)

    def resize(self, width_px: int, height_px: int) -> None:
        self._call(
            "Emulation.setDeviceMetricsOverride", width=width_px, height=height_px, deviceScaleFactor=1, mobile=False
        )

    def evaluate(self, expression: str) -> Any:
        """Return what a JavaScript expression, or the promise that it is, comes to."""
        told = self._call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        return told["result"].get("value", told.get("exceptionDetails"))

    def wait_until(self, expression: str) -> None:
        """Return once `expression` is true."""
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            if self.evaluate(expression) is True:
                return
            time.sleep(0.1)
        raise AssertionError(f"never true: {expression}; {self.errors}")

    def screenshot(self) -> bytes:
        """Return the whole page as JPEG."""
        told = self._call("Page.captureScreenshot", format="jpeg", quality=85, captureBeyondViewport=True)
        return base64.b64decode(told["data"])

    def _call(self, method: str, **parameters: object) -> dict[str, Any]:
        number = next(self._numbers)
        self._connection.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._connection.recv(timeout=PATIENCE_S))
            if message.get("id") == number:
                assert "error" not in message, message
                result: dict[str, Any] = message["result"]
                return result
            self._note(message)

    def _note(self, event: dict[str, Any]) -> None:
        told = event["params"]
        if event["method"] == "Network.requestWillBeSent":
            self.requests.append(told["request"]["url"])
        elif event["method"] == "Network.webSocketCreated":
            self.requests.append(told["url"])
        elif event["method"] == "Log.entryAdded":
            self.errors.append(told["entry"]["text"])
        elif event["method"] == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(told["exceptionDetails"]))


@contextmanager
def browser(program: str, *options: str) -> Iterator[Page]:
    """Start `program` with an empty page; it is gone, with all that it wrote, when the context ends."""
    with tempfile.TemporaryDirectory(prefix="gaiteyes-browser-", ignore_cleanup_errors=True) as folder:
        own_root = ("--no-sandbox",) if os.geteuid() == 0 else ()  # Chromium refuses to run as root with its sandbox
        process = subprocess.Popen(
            [program, "--headless=new", *own_root, *_QUIET, *options, f"--user-data-dir={folder}", "about:blank"],
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
        )
        try:
            with connect(_page_of(process), max_size=None, compression=None) as connection:
                yield Page(connection)
        finally:
            process.terminate()
            with suppress(subprocess.TimeoutExpired):
                process.wait(10.0)
            process.kill()
            process.wait()
            assert process.stderr is not None
            process.stderr.close()


def _page_of(process: subprocess.Popen[str]) -> str:
    """Return the DevTools address of the first page."""
    assert process.stderr is not None
    for line in process.stderr:
        found = re.search(r"DevTools listening on ws://(\S+?)/", line)
        if found:
            break
    else:
        raise AssertionError("the browser did not start")
    import urllib.request

    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        with urllib.request.urlopen(f"http://{found[1]}/json/list") as answer:
            for page in json.load(answer):
                if page["type"] == "page":
                    return str(page["webSocketDebuggerUrl"])
        time.sleep(0.1)
    raise AssertionError("the browser has no page")


_QUIET = (
    "--remote-debugging-port=0",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-dev-shm-usage",
    "--disable-extensions",
    "--disable-gpu",
    "--disable-sync",
    "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",
    "--metrics-recording-only",
    "--no-first-run",
    "--no-proxy-server",
)
