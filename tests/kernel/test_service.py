"""The real unit file under systemd, with an IMU, a camera, a CAN bus and a Zenoh subscriber of this machine.

The tests follow the service's life, in order: a start takes long here, so each but the last leaves it running.
"""

import json
import os
import signal
import time
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import can
import pytest

from daemon.realtime import FIFO_PRIORITIES
from messages.can_frames import CanMessage, can_id
from tests.bench.zenoh_peer import client
from tests.kernel import unit
from tests.kernel.i2c_adapter import set_adapter_timeout
from tests.kernel.wearable import CAN_NAME, DEVICE, Wearable


class Ears:
    """Keeps what the service publishes on Zenoh, by topic, oldest first."""

    def __init__(self, endpoint: str) -> None:
        self.heard: dict[str, list[dict[str, Any]]] = {}
        self._session = client(endpoint)
        self._subscriber = self._session.declare_subscriber(f"gaiteyes/{DEVICE}/*/v2", self._hear)

    def _hear(self, sample: Any) -> None:
        topic = str(sample.key_expr).split("/")[2]
        self.heard.setdefault(topic, []).append(json.loads(bytes(sample.payload)))

    def of(self, topic: str) -> list[dict[str, Any]]:
        """Return what has been heard on `topic` so far."""
        return list(self.heard.get(topic, ()))

    def said(self, topic: str, field: str) -> set[Any]:
        """Return the values that a field has had so far."""
        return {message[field] for message in self.of(topic)}

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
    """Ears on the service, however often it is started anew meanwhile."""
    listening = Ears(wearable.zenoh_endpoint)
    yield listening
    listening.close()


def until_valid(ears: Ears) -> None:
    """Wait for ground that the service calls valid from now on."""
    ears.forget()
    unit.until(lambda: "valid" in ears.said("ground", "status"), "valid ground", pause_s=0.1)


def test_it_says_ready_and_what_it_sees(wearable: Wearable) -> None:
    assert (unit.shown("ActiveState"), unit.shown("SubState")) == ("active", "running")
    unit.until(lambda: unit.shown("StatusText"), "a status line")
    assert unit.shown("NRestarts") == "0", unit.journal()


def test_it_runs_as_its_own_user_without_privileges(wearable: Wearable) -> None:
    with open(f"/proc/{unit.main_pid()}/status", encoding="ascii") as file:
        facts = dict(line.rstrip("\n").split(":\t", 1) for line in file if ":\t" in line)
    assert facts["Uid"].split()[0] != "0"
    assert int(facts["CapEff"], 16) == int(facts["CapBnd"], 16) == 0
    assert (facts["NoNewPrivs"], facts["Seccomp"]) == ("1", "2")


def test_the_imu_is_read_before_everything_else(wearable: Wearable) -> None:
    threads = [int(task) for task in os.listdir(f"/proc/{unit.main_pid()}/task")]
    priorities = [os.sched_getparam(task).sched_priority for task in threads]
    assert max(priorities) == FIFO_PRIORITIES["imu"]
    assert min(priorities) == 0


def test_what_it_publishes_is_live_and_right(ears: Ears, wearable: Wearable) -> None:
    until_valid(ears)
    unit.until(lambda: {"ground", "attitude", "health"} <= ears.heard.keys(), "all topics")
    for ground in ears.of("ground"):
        assert ground["source"] == "live"
        if ground["status"] == "valid":
            assert ground["height_m"] == pytest.approx(wearable.height_m, abs=0.03)
            assert abs(ground["slope_sagittal_rad"]) < 0.05
        else:
            assert ground["height_m"] is None
    health = ears.of("health")[-1]
    assert health["imu_samples"] > 0
    assert health["frames"] > 0
    assert health["zenoh_errors"] == 0


def test_the_ankle_hears_the_ground_on_can(wearable: Wearable) -> None:
    with can.Bus(CAN_NAME, "socketcan") as ankle:
        heard = [ankle.recv(5.0) for _ in range(10)]
    assert can_id(CanMessage.GROUND) in {frame.arbitration_id for frame in heard if frame is not None}


def test_a_reload_takes_what_is_right_and_leaves_the_process(ears: Ears) -> None:
    pid = unit.main_pid()
    file = unit.CONFIGURATION / "gaiteyes.toml"
    before = file.read_text(encoding="utf-8")
    file.write_text("nonsense", encoding="utf-8")
    unit.control("reload")
    unit.until(lambda: "reload refused" in unit.journal(), "the refusal")
    file.write_text(before.replace("ahead_m = 0.7", "ahead_m = 0.65"), encoding="utf-8")
    unit.control("reload")
    unit.until(lambda: 0.65 in ears.said("ground", "ahead_m"), "the new foothold")
    file.write_text(before, encoding="utf-8")
    assert unit.main_pid() == pid


@pytest.mark.parametrize(("device", "reason"), [("camera", "no_frame"), ("chip", "no_imu")])
def test_a_device_unplugged_is_told_and_back_when_it_is(
    ears: Ears, wearable: Wearable, device: str, reason: str
) -> None:
    pid = unit.main_pid()
    until_valid(ears)
    getattr(wearable, device).unplug()
    unit.until(lambda: reason in ears.said("ground", "reason"), reason, pause_s=0.1)
    time.sleep(0.5)
    ears.forget()
    time.sleep(0.5)
    assert "valid" not in ears.said("ground", "status")
    getattr(wearable, device).plug_in()
    until_valid(ears)
    assert unit.main_pid() == pid


def test_a_killed_service_is_started_again(wearable: Wearable) -> None:
    wearable.camera.unplug()
    pid = unit.main_pid()
    os.kill(pid, signal.SIGKILL)
    unit.until_restarted(pid)
    assert unit.shown("NRestarts") == "1"


def test_a_thread_that_hangs_in_a_device_starves_the_watchdog(wearable: Wearable) -> None:
    pid = unit.main_pid()
    unit.until(lambda: unit.shown("StatusText"), "a status line")
    set_adapter_timeout(wearable.chip.bus_number, 600.0)
    time.sleep(0.5)  # a transfer begun under the driver's own limit would end by it, and the driver then set it anew
    wearable.chip.server.mute = True
    unit.until(lambda: unit.main_pid() != pid, "the watchdog")
    wearable.chip.server.mute = False
    set_adapter_timeout(wearable.chip.bus_number, 1.0)
    assert "watchdog" in unit.journal().lower()
    unit.until_restarted(pid)


def test_it_stops_cleanly(wearable: Wearable) -> None:
    unit.control("stop")
    ended = unit.shown("ActiveState"), unit.shown("Result"), unit.shown("ExecMainStatus")
    assert ended == ("inactive", "success", "0"), unit.journal()


def test_it_starts_without_its_devices_and_takes_them_when_they_come(wearable: Wearable) -> None:
    wearable.chip.unplug()
    wearable.camera.unplug()
    unit.control("restart")
    assert unit.shown("ActiveState") == "active"
    with closing(Ears(wearable.zenoh_endpoint)) as ears:
        unit.until(lambda: ears.of("health"), "health")
        assert ears.said("health", "imu_samples") == ears.said("health", "frames") == {0}
        wearable.chip.plug_in()
        wearable.camera.plug_in()
        until_valid(ears)


def test_a_mistake_in_the_configuration_is_one_line_and_no_loop(wearable: Wearable) -> None:
    unit.control("stop")
    (unit.CONFIGURATION / "gaiteyes.toml").write_text("device = 7\n", encoding="utf-8")
    with pytest.raises(AssertionError, match=unit.NAME):
        unit.control("start")
    assert (unit.shown("ActiveState"), unit.shown("ExecMainStatus")) == ("failed", "2")
    assert "gaiteyes.toml" in unit.journal(5)
