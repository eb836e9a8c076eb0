"""`gaiteyes run` as a service manager sees it: a whole process, a real notify socket, real signals, absent devices."""

import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from calib.files import save_calibration
from sim_rig.unit import draw_unit
from tests.bench.zenoh_peer import free_endpoint, taken

pytestmark = [pytest.mark.realtime, pytest.mark.long]

HANGING_CAMERA = """
import sys, threading
import cli.devices
class Hanging:
    dropped = {}
    def __init__(self, *args, **options): pass
    def read(self, timeout_s): threading.Event().wait()
    def close(self): pass
cli.devices.V4l2StereoCamera = Hanging
from cli.main import main
sys.argv = ["gaiteyes", *sys.argv[1:]]
main()
"""
PATIENCE_S = 60.0


class Managed:
    """One service under a manager that is this test; `heard` are the manager's datagrams, split into assignments."""

    def __init__(self, folder: Path, address: str, start: list[str]) -> None:
        self.folder = folder
        self.configuration = folder / "gaiteyes.toml"
        self.endpoint = free_endpoint()
        save_calibration(folder / "calibration.yaml", draw_unit(1).exact_calibration())
        self.configure()
        self._start = start
        self._address = address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind("\0" + address[1:] if address.startswith("@") else address)
        self.heard: list[str] = []
        self.process: subprocess.Popen[bytes] | None = None

    def configure(self, more: str = "") -> None:
        text = (
            "[imu]\nbus = 250\n[camera]\ndevice = '/dev/video97'\n[realtime]\npriorities = false\nlock_memory = false\n"
            f"[zenoh]\nlisten = '{self.endpoint}'\n[can]\ninterface = 'virtual'\nchannel = 'managed'\n"
        )
        self.configuration.write_text(text + more, encoding="utf-8")

    def run(self, start: list[str] | None = None) -> subprocess.Popen[bytes]:
        log = (self.folder / "log").open("wb")
        told = os.fstat(log.fileno())
        environment = os.environ | {
            "NOTIFY_SOCKET": self._address,
            "WATCHDOG_USEC": "10000000",
            "JOURNAL_STREAM": f"{told.st_dev}:{told.st_ino}",
        }
        command = [*(start or self._start), "run", "--config", str(self.configuration)]
        with log, (self.folder / "out").open("wb") as out:
            self.process = subprocess.Popen(command, stdout=out, stderr=log, env=environment)
        return self.process

    def listen(self, until: Callable[[], bool], seconds: float = PATIENCE_S) -> bool:
        """Take what is said until `until()` holds; return whether it did."""
        end_s = time.monotonic() + seconds
        while not until() and time.monotonic() < end_s:
            if select.select([self._socket], [], [], 0.1)[0]:
                self.heard += self._socket.recv(4096).decode().splitlines()
        return until()

    def count(self, word: str) -> int:
        return sum(said.startswith(word) for said in self.heard)

    @property
    def log(self) -> list[str]:
        return (self.folder / "log").read_text(encoding="utf-8").splitlines()

    def close(self) -> None:
        if self.process is not None and self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self._socket.close()


@pytest.fixture(params=["abstract", "path"])
def managed(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Managed]:
    address = f"@gaiteyes-test-{os.getpid()}" if request.param == "abstract" else str(tmp_path / "notify")
    service = Managed(tmp_path, address, [sys.executable, "-m", "cli.main"])
    yield service
    service.close()


def test_without_devices_it_runs_says_so_reloads_and_ends_cleanly(managed: Managed) -> None:
    process = managed.run()
    assert managed.listen(lambda: managed.count("STATUS=invalid: no_frame") > 0), managed.log
    assert managed.heard[:2] == ["READY=1", "WATCHDOG=1"]
    status = next(said for said in managed.heard if said.startswith("STATUS=invalid"))
    assert "/dev/i2c-250" in status
    assert "/dev/video97" in status
    fed = managed.count("WATCHDOG=1")
    assert managed.listen(lambda: managed.count("WATCHDOG=1") > fed + 3)
    assert managed.count("READY=1") == 1

    managed.configure("[foothold]\nahead_m = 9.0\n")
    process.send_signal(signal.SIGHUP)
    assert managed.listen(lambda: managed.count("READY=1") == 2)
    reloading = managed.heard.index("RELOADING=1")
    assert managed.heard[reloading + 1].startswith("MONOTONIC_USEC=")
    assert abs(int(managed.heard[reloading + 1].partition("=")[2]) * 1e-6 - time.monotonic()) < PATIENCE_S
    refused = [line for line in managed.log if "reload refused" in line]
    assert len(refused) == 1
    assert refused[0].startswith("<3>")
    assert "foothold.ahead_m is 9.0, allowed a number from 0.2 to 4" in refused[0]

    managed.configure("[foothold]\nahead_m = 0.9\n")
    process.send_signal(signal.SIGHUP)
    assert managed.listen(lambda: managed.count("READY=1") == 3)
    assert f"<4>configuration read again from {managed.configuration}" in managed.log

    process.terminate()
    assert managed.listen(lambda: process.poll() is not None)
    assert process.returncode == 0, managed.log
    assert managed.count("STOPPING=1") == 1
    assert all(line[0] == "<" and line[2] == ">" for line in managed.log)
    assert (managed.folder / "out").read_bytes() == b""


@pytest.mark.parametrize("managed", ["abstract"], indirect=True)
def test_a_hanging_camera_starves_the_watchdog_and_does_not_keep_the_process(managed: Managed) -> None:
    process = managed.run([sys.executable, "-c", HANGING_CAMERA])
    assert managed.listen(lambda: managed.count("STATUS=invalid: no_frame") > 0), managed.log
    fed = managed.count("WATCHDOG=1")
    assert fed == 1, "only the round in which it began to hang"
    assert not managed.listen(lambda: managed.count("WATCHDOG=1") > fed, seconds=2.0)
    process.terminate()
    assert managed.listen(lambda: process.poll() is not None)
    assert process.returncode == 1
    assert "<3>thread camera of the service hangs and was given up" in managed.log


@pytest.mark.parametrize("managed", ["abstract"], indirect=True)
def test_what_a_person_must_mend_ends_with_2_and_what_may_pass_with_1(managed: Managed) -> None:
    with taken(managed.endpoint):
        assert managed.run().wait(PATIENCE_S) == 1
    assert managed.endpoint in managed.log[-1]
    managed.configure("[nonsense]\n")
    assert managed.run().wait(PATIENCE_S) == 2
    assert managed.count("READY=1") == 0
