"""What the service manager hears, on real sockets, and when nobody listens."""

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from daemon.sd_notify import ServiceManager
from daemon.watchdog import Progress


@pytest.fixture(params=["path", "abstract"])
def heard(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[socket.socket, str]]:
    """Yield a manager's socket and its address as the environment names it."""
    manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    name = str(tmp_path / "notify") if request.param == "path" else f"@gaiteyes-unit-{os.getpid()}"
    manager.bind("\0" + name[1:] if name.startswith("@") else name)
    yield manager, name
    manager.close()


def test_the_first_sign_of_life_says_ready_and_a_status_is_said_when_it_changes(
    heard: tuple[socket.socket, str],
) -> None:
    listening, name = heard
    manager = ServiceManager({"NOTIFY_SOCKET": name})
    manager.feed_watchdog()
    manager.feed_watchdog()
    for line in ("no frame", "no frame", "slope 1°"):
        manager.status(line)
    manager.stopping()
    manager.close()
    manager.stopping()
    said = [listening.recv(4096).decode() for _ in range(5)]
    assert said == ["READY=1\nWATCHDOG=1", "WATCHDOG=1", "STATUS=no frame", "STATUS=slope 1°", "STOPPING=1"]
    with pytest.raises(BlockingIOError):
        listening.recv(4096)


@pytest.mark.parametrize("environment", [{}, {"NOTIFY_SOCKET": "/nowhere/notify"}, {"NOTIFY_SOCKET": "@nobody-here"}])
def test_words_that_nobody_hears_do_no_harm(environment: dict[str, str]) -> None:
    manager = ServiceManager(environment)
    assert manager.is_there is bool(environment)
    manager.feed_watchdog()
    manager.status("x")
    manager.close()


def test_every_loop_has_to_come_round_for_each_meal_of_the_watchdog() -> None:
    progress = Progress(("imu", "camera"))
    assert not progress.all_advanced()
    progress.count_round("imu")
    assert progress.stuck == ("camera",)
    assert not progress.all_advanced()
    progress.count_round("camera")
    assert progress.all_advanced()
    assert not progress.all_advanced()
    for _ in range(5):
        progress.count_round("imu")
    assert not progress.all_advanced(), "one loop alone never feeds it"
