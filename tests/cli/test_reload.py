"""A reload while the service runs: what can change takes effect, no IMU sample is lost, a replay says the same."""

import logging
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from calib.files import save_calibration
from cli.reload import Reloader
from cli.wiring import Outlets, build_service, open_outlets, open_recorder
from daemon.config import load_configuration, parse_configuration
from daemon.pipeline import Pipeline
from daemon.replaceable_camera import ReplaceableCamera
from daemon.replay import replay
from daemon.service import Service
from drivers.recording.recording import McapRecording
from messages import Attitude, Calibration, Estimate, FrameHeader, GroundPlane, ImuSample, Reconfigured, Source, Status
from messages.codec import encode
from perception.ground.foothold import FootholdSettings
from sim_rig.unit import draw_unit
from tests.bench.quiet_devices import GreyCamera, QuietImu
from tests.bench.zenoh_peer import client, free_endpoint


class Unit:
    """A running service on fakes of devices, with real outlets, its files in `folder`."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "gaiteyes.toml"
        self.recording = folder / "run.mcap"
        self.endpoint = free_endpoint()
        self.calibration: Calibration = draw_unit(1).exact_calibration()
        save_calibration(folder / "calibration.yaml", self.calibration)
        self.write()
        configuration = load_configuration(self.path)
        self.imu, self.cameras = QuietImu(), [GreyCamera()]
        self.camera = ReplaceableCamera(lambda: self.cameras[0])
        self.outlets: Outlets = open_outlets(configuration, self.calibration)
        self.heard: list[Estimate] = []
        recorder = open_recorder(self.recording, configuration, self.calibration, Source.LIVE, None)
        self.service: Service = build_service(
            configuration, self.calibration, Source.LIVE, self.imu, self.camera, self.outlets, recorder, [self._hear]
        )
        self.reloader = Reloader(self.path, configuration, self.calibration, self.service, self.camera, self.outlets)

    def write(self, text: str = "", *, endpoint: str = "", can: str = "before") -> None:
        listen = endpoint or self.endpoint
        text = f"[zenoh]\nlisten = '{listen}'\n[can]\ninterface = 'virtual'\nchannel = 'reload-{can}'\n" + text
        self.path.write_text(text, encoding="utf-8")

    def _hear(self, estimate: Estimate, _header: FrameHeader | None) -> None:
        self.heard.append(estimate)

    def grounds(self, ahead_m: float) -> int:
        return sum(isinstance(e, GroundPlane) and e.ahead_m == ahead_m for e in self.heard)

    def knows_attitude(self) -> bool:
        return any(isinstance(e, Attitude) and e.status is Status.VALID for e in self.heard)

    def run(self, *acts: "Act") -> None:
        """Run the service; do each act in turn, as soon as it may be done."""
        waiting = list(acts)

        def turn() -> None:
            if waiting and waiting[0].due():
                waiting.pop(0).do()
            elif not waiting:
                self.service.stop()

        self.service.run(30.0, each_s=0.02, status=turn)
        assert not waiting, f"never came: {waiting[0].what}"


class Act:
    def __init__(self, what: str, due: object, do: object = lambda: None) -> None:
        assert callable(due)
        assert callable(do)
        self.what, self.due, self.do = what, due, do


@pytest.fixture
def unit(tmp_path: Path) -> Iterator[Unit]:
    running = Unit(tmp_path)
    threads = threading.active_count()
    yield running
    assert threading.active_count() <= threads


def test_foothold_camera_can_and_zenoh_change_while_the_imu_goes_on(
    unit: Unit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    another, endpoint = GreyCamera(), free_endpoint()
    monkeypatch.setattr("cli.reload.camera_opener", lambda _config, _calibration: lambda: another)
    answers: list[bytes] = []

    def change() -> None:
        new = "[foothold]\nahead_m = 0.9\n[camera]\ndevice = '/dev/video9'\n"
        unit.write(new, endpoint=endpoint, can="after")
        unit.reloader.reload()
        with client(endpoint) as session:
            answers.extend(bytes(r.ok.payload) for r in session.get("gaiteyes/gaiteyes/configuration") if r.ok)

    unit.run(
        Act("a known attitude", lambda: unit.grounds(0.7) > 5 and unit.knows_attitude(), change),
        Act("ground at the second", lambda: unit.grounds(0.9) > 5),
    )
    assert unit.cameras[0].closed
    assert another.closed
    assert len(answers) == 1
    assert b'"ahead_m":0.9' in answers[0]
    with pytest.raises(zenoh.ZError):
        client(unit.endpoint)

    statuses = [e.status for e in unit.heard if isinstance(e, Attitude)]
    assert Status.INITIALISING not in statuses[statuses.index(Status.VALID) :], "the filter started anew"

    recording = McapRecording(unit.recording)
    inputs = list(recording.inputs())
    assert sum(isinstance(message, Reconfigured) for message in inputs) == 1
    numbers = [message.seq for message in inputs if isinstance(message, ImuSample)]
    assert numbers == list(range(1, len(numbers) + 1))
    again = replay(inputs, Pipeline(unit.calibration, recorded_foothold(recording)), tmp_path / "out.jsonl")
    live = [e for e in unit.heard if isinstance(e, GroundPlane)]
    assert [encode(ground) for ground in again.grounds] == [encode(ground) for ground in live]


def recorded_foothold(recording: McapRecording) -> FootholdSettings:
    return parse_configuration(recording.configuration_text, "recorded").foothold


@pytest.mark.parametrize("text", ["[foothold]\nahead_m = 9.0\n", "calibration = 'nowhere.yaml'\n"])
def test_a_wrong_file_changes_nothing_and_is_one_line(unit: Unit, caplog: pytest.LogCaptureFixture, text: str) -> None:
    def change() -> None:
        unit.path.write_text(text + "[can]\nchannel = 'never'\n", encoding="utf-8")
        unit.reloader.reload()
        unit.heard.clear()

    with caplog.at_level(logging.WARNING, "gaiteyes"):
        unit.run(
            Act("ground", lambda: unit.grounds(0.7) > 2, change),
            Act("ground as before", lambda: unit.grounds(0.7) > 2),
        )
    told = [record for record in caplog.records if "reload" in record.message]
    assert len(told) == 1
    assert told[0].levelno == logging.ERROR
    assert "\n" not in told[0].message


def test_what_cannot_change_while_running_is_said(unit: Unit, caplog: pytest.LogCaptureFixture) -> None:
    def change() -> None:
        save_calibration(unit.path.parent / "calibration.yaml", draw_unit(2).exact_calibration())
        text = unit.path.read_text(encoding="utf-8")
        other = "device = 'other'\n" + text + "[imu]\nbus = 7\n[foothold]\nmatching_width_px = 1280\n"
        unit.path.write_text(other, encoding="utf-8")
        unit.reloader.reload()

    with caplog.at_level(logging.WARNING, "gaiteyes"):
        unit.run(Act("ground", lambda: unit.grounds(0.7) > 2, change))
    told = [record.message for record in caplog.records if "next start" in record.message]
    assert [line.split(" takes")[0] for line in told] == [
        f"reload: calibration {draw_unit(2).exact_calibration().id}",
        "reload: the new foothold.matching_width_px",
        "reload: the new device",
        "reload: the new imu",
    ]
