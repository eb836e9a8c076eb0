"""Beside a running service the page shows what it publishes, goes on after a new start, and costs no frame."""

import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest

from cli.viewer.board import NOTHING_YET, Board, News
from cli.viewer.live import LiveSource, follow_device
from cli.wiring import build_service, open_outlets
from daemon.config import Configuration, ViewSettings
from drivers.can.settings import CanSettings
from drivers.picture_socket import devices_here
from drivers.zenoh import local_socket
from messages import Calibration, Source, UserError
from sim_rig.unit import draw_unit
from tests.bench.quiet_devices import GreyCamera, QuietImu

PATIENCE_S = 30.0
_DEFAULT = ViewSettings()


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return draw_unit(1).exact_calibration()


@pytest.fixture(autouse=True)
def own_directory(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with tempfile.TemporaryDirectory(prefix="gaiteyes-") as folder:  # pytest's own paths are too long for sockets
        monkeypatch.setattr(local_socket, "SERVICE_DIRECTORY", Path(folder) / "none")
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        monkeypatch.setenv("HOME", folder)
        yield


def test_what_a_service_says_is_shown_and_again_after_a_new_start(calibration: Calibration) -> None:
    board = Board("bench")
    with pytest.raises(UserError, match="does not run"):
        LiveSource("bench", board)
    with _running(calibration):
        assert devices_here() == ["bench"]
        threading.Thread(target=follow_device, args=("bench", board), daemon=True).start()
        _until(lambda: _news(board).picture > 3 and b"no ground: low_texture" in _news(board).text)
        news = _news(board)
        facts = msgspec.json.decode(news.text)["facts"]
        assert facts["source"] == "simulated"
        assert facts["ground"] == "no ground: low_texture"
        assert facts["latency"].startswith("p50 ")
        assert news.point > 0
        assert news.jpeg is not None
    _until(lambda: b"has ended" in _news(board).text)
    pictures = _news(board).picture
    with _running(calibration):
        _until(lambda: _news(board).picture > pictures + 3)


@pytest.mark.long
def test_without_pictures_the_rest_is_shown_on_grey(calibration: Calibration) -> None:
    board = Board("bench")
    with _running(calibration, ViewSettings(pictures=False)):
        threading.Thread(target=follow_device, args=("bench", board), daemon=True).start()
        _until(lambda: _news(board).picture > 1)


@contextmanager
def _running(calibration: Calibration, view: ViewSettings = _DEFAULT) -> Iterator[None]:
    """A service on fakes, in a thread."""
    configuration = Configuration(device="bench", view=view, can=CanSettings(channel="view"))
    outlets = open_outlets(configuration, calibration)
    service = build_service(configuration, calibration, Source.SIMULATED, QuietImu(), GreyCamera(), outlets, None, [])
    thread = threading.Thread(target=service.run)
    thread.start()
    try:
        yield
    finally:
        service.stop()
        thread.join()


def _news(board: Board) -> News:
    news = board.news(NOTHING_YET, 0.0)
    assert news is not None
    return news


def _until(holds: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < end_s
        time.sleep(0.02)
