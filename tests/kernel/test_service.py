"""The real unit file under systemd, with an IMU, a camera, a CAN bus and a Zenoh subscriber of this machine.

Each test leaves the service running on all its devices, as it found it.
"""

import json
import os
import signal
import time
from collections.abc import Iterator
from typing import Any

import can
import pytest

from daemon.realtime import FIFO_PRIORITIES
from messages.can_frames import CanMessage, can_id
from tests.kernel import unit
from tests.kernel.i2c_adapter import set_adapter_timeout
from tests.kernel.wearable import CAN_NAME, DEVICE, Wearable
from tests.zenoh_peer import client


class Ears:
    """Keeps what the service publishes on Zenoh, by topic, oldest first."""

    def __init__(self, endpoint: str) -> None:
        self.heard: dict[str, list[dict[str, Any]]] = {}
        self._session = client(endpoint)
        self._subscriber = self._session.declare_subscriber(f"gaiteyes/{DEVICE}/*/v1", self._hear)

    def _hear(self, sample: Any) -> None:
        topic = str(sample.key_expr).split("/")[2]
        self.heard.setdefault(topic, []).append(json.loads(bytes(sample.payload)))

    def of(self, topic: str) -> list[dict[str, Any]]:
        """Return what has been heard on `topic` so far."""
        return list(self.heard.get(topic, ()))

    def newest(self, topic: str, field: str) -> Any:
        """Return a field of the newest message, None if there is none."""
        return self.of(topic)[-1].get(field) if self.of(topic) else None

    def forget(self) -> None:
        """Begin anew."""
        self.heard.clear()

    def close(self) -> None:
        """Hang up."""
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]  # zenoh's own
        self._session.close()  # type: ignore[no-untyped-call]


@pytest.fixture(scope="module")
def wearable() -> Iterator[Wearable]:
    unit.install()
    made = Wearable()
    unit.apply_device_rules()
    made.write_files(unit.CONFIGURATION)
    unit.control("start")
    yield made
    unit.control("stop")
    made.close()


@pytest.fixture
def ears(wearable: Wearable) -> Iterator[Ears]:
    """Ears on a service that sees and feels."""
    listening = Ears(wearable.zenoh_endpoint)
    unit.until(lambda: listening.newest("ground", "status") == "valid", "valid ground")
    listening.forget()
    yield listening
    listening.close()


def test_it_says_ready_and_what_it_sees(ears: Ears) -> None:
    assert (unit.shown("ActiveState"), unit.shown("SubState")) == ("active", "running")
    unit.until(lambda: unit.shown("StatusText"), "a status line")
    assert unit.shown("NRestarts") == "0", unit.journal()


def test_it_runs_as_its_own_user_without_privileges(ears: Ears) -> None:
    with open(f"/proc/{unit.main_pid()}/status", encoding="ascii") as file:
        facts = dict(line.rstrip("\n").split(":\t", 1) for line in file if ":\t" in line)
    assert facts["Uid"].split()[0] != "0"
    assert int(facts["CapEff"], 16) == int(facts["CapBnd"], 16) == 0
    assert (facts["NoNewPrivs"], facts["Seccomp"]) == ("1", "2")


def test_every_estimate_is_published_live_and_right(ears: Ears, wearable: Wearable) -> None:
    unit.until(lambda: {"ground", "attitude", "health"} <= ears.heard.keys(), "all topics")
    unit.until(lambda: len(ears.of("ground")) >= 20, "twenty estimates")
    valid = [ground for ground in ears.of("ground") if ground["status"] == "valid"]
    assert valid
    for ground in valid:
        assert ground["source"] == "live"
        assert ground["height_m"] == pytest.approx(wearable.height_m, abs=0.03)
        assert abs(ground["slope_sagittal_rad"]) < 0.05
    health = ears.of("health")[-1]
    assert health["imu_samples"] > 0
    assert health["frames"] > 0
    assert health["zenoh_errors"] == 0


def test_the_ankle_hears_the_ground_on_can(ears: Ears) -> None:
    with can.Bus(CAN_NAME, "socketcan") as ankle:
        heard = [ankle.recv(5.0) for _ in range(10)]
    identifiers = {frame.arbitration_id for frame in heard if frame is not None}
    assert can_id(CanMessage.GROUND) in identifiers


def test_the_imu_is_read_before_everything_else(ears: Ears) -> None:
    threads = [int(task) for task in os.listdir(f"/proc/{unit.main_pid()}/task")]
    priorities = [os.sched_getparam(task).sched_priority for task in threads]
    assert max(priorities) == FIFO_PRIORITIES["imu"]
    assert min(priorities) == 0


def test_a_camera_unplugged_is_told_and_back_when_it_is(ears: Ears, wearable: Wearable) -> None:
    pid = unit.main_pid()
    wearable.camera.unplug()
    unit.until(lambda: ears.newest("ground", "status") == "invalid", "invalid ground")
    assert ears.newest("ground", "height_m") is None
    wearable.camera.plug_in()
    unit.until(lambda: ears.newest("ground", "status") == "valid", "valid ground")
    assert unit.main_pid() == pid


def test_an_imu_unplugged_is_told_and_back_when_it_is(ears: Ears, wearable: Wearable) -> None:
    pid = unit.main_pid()
    wearable.chip.unplug()
    unit.until(lambda: ears.newest("ground", "status") == "invalid", "invalid ground")
    wearable.chip.plug_in()
    unit.until(lambda: ears.newest("ground", "status") == "valid", "valid ground")
    assert unit.main_pid() == pid


def test_a_reload_takes_the_new_configuration_and_leaves_the_process(ears: Ears) -> None:
    pid = unit.main_pid()
    file = unit.CONFIGURATION / "gaiteyes.toml"
    before = file.read_text(encoding="utf-8")
    file.write_text(before.replace("ahead_m = 0.7", "ahead_m = 0.65"), encoding="utf-8")
    unit.control("reload")
    unit.until(lambda: ears.newest("ground", "ahead_m") == pytest.approx(0.65), "the new foothold")
    file.write_text("nonsense", encoding="utf-8")
    unit.control("reload")
    time.sleep(1.0)
    assert ears.newest("ground", "ahead_m") == pytest.approx(0.65)
    file.write_text(before, encoding="utf-8")
    unit.control("reload")
    unit.until(lambda: ears.newest("ground", "ahead_m") == pytest.approx(0.7), "the old foothold")
    assert unit.main_pid() == pid


def test_a_killed_service_is_started_again(wearable: Wearable) -> None:
    pid, restarts = unit.main_pid(), int(unit.shown("NRestarts"))
    os.kill(pid, signal.SIGKILL)
    unit.until_restarted(pid)
    assert int(unit.shown("NRestarts")) == restarts + 1


def test_a_stopped_process_starves_the_watchdog_and_is_started_again(ears: Ears) -> None:
    pid = unit.main_pid()
    os.kill(pid, signal.SIGSTOP)
    unit.until_restarted(pid)
    assert "watchdog" in unit.journal().lower()


def test_a_thread_that_hangs_in_a_device_starves_the_watchdog(ears: Ears, wearable: Wearable) -> None:
    pid = unit.main_pid()
    set_adapter_timeout(wearable.chip.bus_number, 20.0)
    wearable.chip.server.mute = True
    unit.until(lambda: unit.main_pid() != pid, "the watchdog")
    wearable.chip.server.mute = False
    set_adapter_timeout(wearable.chip.bus_number, 1.0)
    unit.until_restarted(pid)


def test_it_starts_without_its_devices_and_takes_them_when_they_come(ears: Ears, wearable: Wearable) -> None:
    ears.close()
    wearable.chip.unplug()
    wearable.camera.unplug()
    unit.control("restart")
    assert unit.shown("ActiveState") == "active"
    later = Ears(wearable.zenoh_endpoint)
    unit.until(lambda: later.of("health"), "health")
    assert later.newest("health", "imu_samples") == 0
    wearable.chip.plug_in()
    wearable.camera.plug_in()
    unit.until(lambda: later.newest("ground", "status") == "valid", "valid ground")
    later.close()


def test_it_stops_cleanly(ears: Ears) -> None:
    ears.close()
    unit.control("stop")
    assert (unit.shown("ActiveState"), unit.shown("Result"), unit.shown("ExecMainStatus")) == (
        "inactive",
        "success",
        "0",
    ), unit.journal()
    unit.control("start")


def test_a_mistake_in_the_configuration_is_one_line_and_no_loop(ears: Ears) -> None:
    ears.close()
    unit.control("stop")
    file = unit.CONFIGURATION / "gaiteyes.toml"
    before = file.read_text(encoding="utf-8")
    file.write_text("device = 7\n", encoding="utf-8")
    with pytest.raises(AssertionError, match=unit.NAME):
        unit.control("start")
    assert (unit.shown("ActiveState"), unit.shown("ExecMainStatus")) == ("failed", "2")
    assert "gaiteyes.toml" in unit.journal(5)
    file.write_text(before, encoding="utf-8")
    unit.control("start")
