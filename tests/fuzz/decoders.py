"""Every decoder of the project as a function of bytes: it takes them, refuses them in one line, or has a fault.

`decode` of a `Decoder` gets an input and an empty folder. It returns whether the input was taken; a UserError is a
refusal, whatever else is raised a fault. `costs` is the time of one input relative to the cheapest: the share of a
decoder in a campaign is its inverse.
"""

import gzip
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from hypothesis import strategies as st

from calib.asl_yaml import load_asl_calibration
from calib.files import load_calibration, seal_file
from calib.zed_conf import load_zed_conf
from daemon.config import load_configuration
from daemon.replay_source import open_source
from daemon.state_file import read_state
from discrepancy.report.extended import read_extended
from drivers.recording.asl_folder import read_truth
from drivers.recording.asl_tables import read_table
from impedance.ankle.table import load_table
from impedance.ankle.trial import load_trial
from impedance.recording.c3d import read_c3d
from impedance.recording.recording import PlatformRecording
from messages import Attitude, Estimate, GroundPlane, Health, Motion, PropagatedGround, Terrain, UserError
from messages.can_estimates import PAIRS, CanEstimate
from messages.can_frames import CanMessage, can_id, decode_ankle, profile
from messages.can_receiver import CanReceiver
from messages.e2e import E2eCheck, E2eReceiver
from messages.errors import LONGEST_LINE
from messages.json_receiver import JsonReceiver, Received
from tests.bench.asl import camera_yaml, imu_rows
from tests.bench.zed_conf_file import sections, text_of
from tests.fuzz import samples
from tests.fuzz.damage import damaged_bytes, damaged_text

Decode = Callable[[bytes, Path], bool]


class Decoder(NamedTuple):
    """One decoder under test: sound `samples`, which may take a moment, and how they are damaged."""

    name: str
    samples: Callable[[], tuple[bytes, ...]]
    decode: Decode
    damage: Callable[[tuple[bytes, ...]], st.SearchStrategy[bytes]] = damaged_text
    costs: float = 1.0


def outcome(decoder: Decoder, data: bytes, folder: Path) -> bool:
    """Return whether `data` was taken; raises AssertionError where a refusal is not one short line."""
    try:
        return decoder.decode(data, folder)
    except UserError as refusal:
        line = str(refusal)
        assert line, "an empty refusal"
        assert "\n" not in line, line
        assert line.isprintable(), line
        assert len(line) <= LONGEST_LINE, line
        return False


def _file(name: str, read: Callable[[Path], object]) -> Decode:
    """Return the decoder that reads a file of its own."""

    def decode(data: bytes, folder: Path) -> bool:
        path = folder / name
        path.write_bytes(data)
        read(path)
        return True

    return decode


def _folder(name: str, files: Callable[[], dict[str, bytes]], read: Callable[[Path], object]) -> Decode:
    """Return the decoder that reads a folder, sound but for the file called `name`."""

    def decode(data: bytes, folder: Path) -> bool:
        for each, sound in files().items():
            (folder / each).write_bytes(data if each == name else sound)
        read(folder)
        return True

    return decode


def _calibration(path: Path) -> None:
    assert seal_file(path) == load_calibration(path)


def _state(path: Path) -> None:
    """Read the state as it is, and once more with the checksum that it needs."""
    body = path.read_bytes().partition(b"\n")[0]
    try:
        read_state(path, samples.CALIBRATION)
    except UserError:
        path.write_bytes(body + b"\n" + hashlib.sha256(body).hexdigest().encode() + b"\n")
        read_state(path, samples.CALIBRATION)


def _asl_sensors(path: Path) -> None:
    other = path.with_name("cam1.yaml")
    other.write_text(camera_yaml(60, 40, -0.06))
    load_asl_calibration({"cam0": path, "cam1": other}, "bench")


def _recording(path: Path) -> None:
    source = open_source(path, None)
    for _ in source.inputs():
        pass
    source.rig_truth()


def _imu_table(path: Path) -> None:
    read_table(path, 6)


def _zed_conf(path: Path) -> None:
    load_zed_conf(path, "HD")


def _extended(path: Path) -> None:
    read_extended(path, "platform")


def _layout(path: Path) -> None:
    """Read the layout of a C3D file that is not there, which is looked for last."""
    try:
        read_c3d(path.with_name("none.c3d"), path)
    except UserError as refusal:
        if "no such file" not in str(refusal):
            raise


def _c3d(path: Path) -> None:
    layout = path.with_name("layout.toml")
    layout.write_bytes(samples.c3d_layout())
    read_c3d(path, layout)


def _payload(data: bytes, _folder: Path) -> bool:
    kinds: tuple[type[Estimate], ...] = (GroundPlane, PropagatedGround, Attitude, Motion, Terrain, Health)
    receivers = [JsonReceiver(kind, samples.DEVICE, boot_id=samples.BOOT) for kind in kinds]
    t_ns = samples.T_NS + 1_000_000
    return any(isinstance(receiver.feed(data, t_ns, t_ns), Received) for receiver in receivers)


FRAME_NS = 8_000_000
"""From one frame of a bus to the next."""


def _bus(data: bytes, _folder: Path) -> bool:
    receivers, ankle = [CanReceiver(kind) for kind in PAIRS], E2eReceiver(profile(CanMessage.ANKLE_STATE))
    taken, place, t_ns = False, 0, 0
    while place < len(data):
        frame_id, length = int.from_bytes(data[place : place + 2], "big"), data[place + 2 : place + 3]
        frame = data[place + 3 : place + 3 + (length[0] if length else 0)]
        place, t_ns = place + 3 + len(frame), t_ns + FRAME_NS
        for receiver in receivers:
            taken |= isinstance(receiver.feed(frame_id, frame, t_ns), CanEstimate)
        if frame_id == can_id(CanMessage.ANKLE_STATE) and ankle.check(frame, t_ns) is E2eCheck.OK:
            decode_ankle(frame, t_ns)
    return taken


def _platform(name: str) -> Decoder:
    return Decoder(
        f"platform {name}",
        lambda: (samples.platform_files()[name],),
        _folder(name, samples.platform_files, PlatformRecording.load),
        costs=4.0,
    )


def _trial(name: str) -> Decoder:
    return Decoder(
        f"ankle trial {name}",
        lambda: (samples.trial_files()[name],),
        _folder(name, samples.trial_files, load_trial),
        costs=4.0,
    )


_IMU_TABLE = "\n".join(("#timestamp [ns],w x,y,z,a x,y,z", *imu_rows(30))).encode()
_TRUTH_TABLE = b"\n".join(b"%d,0.5,-1,2e-3,1,0,0,0,7" % t_ns for t_ns in range(10**9, 2 * 10**9, 5 * 10**7))
_SENSOR = camera_yaml(60, 40, 0.06).encode()
_CONF = text_of(sections()).encode()

DECODERS = (
    Decoder("calibration", samples.calibrations, _file("unit.yaml", _calibration), costs=6.0),
    Decoder("configuration", samples.configurations, _file("gaiteyes.toml", load_configuration)),
    Decoder("state file", samples.states, _file("learnt.json", _state)),
    Decoder("Zenoh payload", samples.payloads, _payload),
    Decoder("CAN frames", samples.buses, _bus, damaged_bytes, costs=2.0),
    Decoder("recording", samples.recordings, _file("walk.mcap", _recording), damaged_bytes, costs=4.0),
    Decoder("ZED conf", lambda: (_CONF,), _file("SN1.conf", _zed_conf)),
    Decoder("ASL sensor file", lambda: (_SENSOR,), _file("cam0.yaml", _asl_sensors), costs=6.0),
    Decoder("ASL table", lambda: (_IMU_TABLE,), _file("imu0.csv", _imu_table)),
    Decoder("ASL truth", lambda: (_TRUTH_TABLE,), _file("truth.csv", read_truth)),
    Decoder("ASL table, gzip", lambda: (gzip.compress(_IMU_TABLE),), _file("imu0.csv.gz", _imu_table), damaged_bytes),
    *(_platform(name) for name in ("platform.toml", "motion.csv", "force_plate.csv")),
    *(_trial(name) for name in ("trial.toml", "cycles.csv", "events.csv")),
    Decoder("ankle table", lambda: (samples.ANKLE_TABLE,), _file("ankle_impedance.toml", load_table)),
    Decoder("extended model", lambda: (samples.EXTENDED,), _file("extended.toml", _extended)),
    Decoder("C3D layout", lambda: (samples.c3d_layout(),), _file("layout.toml", _layout)),
    Decoder("C3D", samples.c3d_files, _file("trial.c3d", _c3d), damaged_bytes, costs=300.0),
)


def chosen_decoders(only: str | None) -> list[Decoder]:
    """Return the decoders whose names begin with `only`, or all; raises SystemExit where there is none."""
    chosen = [each for each in DECODERS if only is None or each.name.startswith(only)]
    if not chosen:
        raise SystemExit(f"--only {only}: none of {', '.join(each.name for each in DECODERS)}")
    return chosen
