"""A sound, small document for each decoder: what fuzzing begins with."""

import tempfile
from datetime import datetime, timezone
from functools import cache
from pathlib import Path

import msgspec
import numpy as np

from calib.files import format_calibration
from daemon.config import CameraSettings, Configuration, format_configuration
from daemon.recorder import Recorder, RecordingInfo
from daemon.recording_file import Recordable
from daemon.state_file import write_state
from impedance.ankle.trial import Perturbation, save_trial
from impedance.recording.recording import PlatformRecording
from messages import (
    TOPIC_OF,
    AnkleState,
    BiasAtTemperature,
    Calibration,
    DepthScale,
    Estimate,
    GaitPhase,
    Learnt,
    Source,
    StereoFrame,
)
from messages.can_encoder import CanEncoder
from messages.can_frames import CanFrame
from messages.codec import encode_line
from sim_rig.camera.depth_unit import draw_depth_unit
from sim_rig.platform import ankle, ankle_measured
from sim_rig.platform.ankle_person import person
from sim_rig.platform.rig import FOOT, PLATE, Rig
from sim_rig.platform.run import RunSettings, measured, simulate
from sim_rig.unit import draw_unit
from tests.bench.can_samples import attitude, ground, health, invalid_ground, motion, propagated_ground, stamp, terrain
from tests.bench.recorded import walk

DEVICE, BOOT = "unit-1", "boot"
_ANKLE = AnkleState(
    t_sample_ns=1_000_000_000, ankle_angle_rad=0.1, ankle_rate_radps=-0.5, load_n=700.0, phase=GaitPhase.STANCE
)
T_NS = 50_000_000_000
CALIBRATION: Calibration = draw_unit(1).exact_calibration()

EXTENDED = b"""\
system = "platform"
[parameters.plate_mass]
value = 4.64
low = 4.6
high = 4.7
unit = "kg"
[effects.lever]
offset = { value = -0.01, low = -0.02, high = inf, unit = "m" }
"""

_AXIS = """
stiffness_nm_per_rad = [100.0, nan, 120.0]
stiffness_nm_per_rad_low = [90.0, -10.0, 110.0]
stiffness_nm_per_rad_high = [110.0, 130.0, 130.0]
damping_nms_per_rad = [1.0, 1.1, 1.2]
damping_nms_per_rad_low = [0.9, 1.0, 1.1]
damping_nms_per_rad_high = [1.1, 1.2, 1.3]
foot_inertia_kgm2 = 0.004
foot_inertia_kgm2_low = 0.003
foot_inertia_kgm2_high = 0.005
not_identifiable = ["stiffness at 30 %"]
"""
ANKLE_TABLE = f"""\
manoeuvre = "straight"
ground_slope_deg = 0.0
subject = "S5"
body_mass_kg = 75.0
perturbed_cycles = 40
stance_percent = [20.0, 30.0, 40.0]
[dorsi_plantarflexion]{_AXIS}
[inversion_eversion]{_AXIS}""".encode()


def calibrations() -> tuple[bytes, ...]:
    """Return the files of a stereo unit and of one with a depth camera, not sealed."""
    return tuple(
        format_calibration(each).encode() for each in (CALIBRATION, draw_depth_unit(1, perfect_calibration=True)[1])
    )


def configurations() -> tuple[bytes, ...]:
    """Return all defaults, and a file with what has none."""
    fixed = CameraSettings(exposure_s=0.004, gain_percent=20.0)
    pair = CameraSettings(left="/dev/video0", right="/dev/video2")
    return tuple(
        format_configuration(each).encode()
        for each in (Configuration(), Configuration(camera=fixed), Configuration(camera=pair))
    )


def learnt() -> Learnt:
    """Return what a unit may have learnt beside CALIBRATION."""
    known = (1e-3, -2e-3, 5e-4)
    at = [
        BiasAtTemperature(
            temperature_degC=temperature_degC,
            gyro_bias_radps=known,
            gyro_std_radps=(1e-4, 1e-4, 1e-4),
            sf_bias_mps2=(0.0, 0.0, 0.0),
            sf_std_mps2=(0.01, 0.01, 0.01),
            seen_s=100.0,
        )
        for temperature_degC in (25.0, 31.5)
    ]
    scale = DepthScale(scale=0.0, std=0.0004, seen_s=116.0)
    return Learnt(calibration_id=CALIBRATION.id, used_s=120.0, biases=tuple(at), depth_scale=scale)


def states() -> tuple[bytes, ...]:
    """Return a state file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "learnt.json"
        write_state(path, learnt(), datetime(2026, 11, 1, tzinfo=timezone.utc))
        return (path.read_bytes(),)


def payloads() -> tuple[bytes, ...]:
    """Return a published line of every topic, captured 40 ms before it."""
    told: tuple[Estimate, ...] = (
        ground(),
        invalid_ground(),
        propagated_ground(),
        attitude(),
        motion(),
        terrain(),
        health(),
    )
    lines = []
    for estimate in told:
        event = next(name for name in ("t_exposure_ns", "t_sample_ns", "t_ns") if hasattr(estimate, name))
        message = msgspec.structs.replace(estimate, **{event: T_NS - 40_000_000})
        named = stamp(device=DEVICE, boot_id=BOOT, seq=1, t_publish_ns=T_NS, age_s=0.040)
        lines.append(encode_line(TOPIC_OF[type(message)], message, named))
    return tuple(lines)


def buses() -> tuple[bytes, ...]:
    """Return the frames of half a second of CAN, each as identifier (2 bytes), length and data."""
    encoder, frames = CanEncoder(), list[CanFrame]()
    for seq in range(10):
        sealed = stamp(seq=seq)
        frames += encoder.ground(ground(), sealed, 0.04)
        frames += encoder.propagated_ground(propagated_ground(), sealed, 0.004)
        frames += encoder.foothold(terrain(), sealed, 0.04)
        frames += encoder.terrain(terrain(), sealed, 0.04)
        frames.append(encoder.ankle(_ANKLE))
    frames.append(encoder.health(health(), stamp()))
    return (b"".join(frame.can_id.to_bytes(2, "big") + bytes([len(frame.data)]) + frame.data for frame in frames),)


def recordings() -> tuple[bytes, ...]:
    """Return a short recording with every kind of message, closed, and the same without frames."""
    info = RecordingInfo(
        device="bench",
        source=Source.SIMULATED,
        calibration_text=format_calibration(CALIBRATION),
        configuration_text=format_configuration(Configuration()),
        learnt=learnt(),
    )
    stereo = walk(0.3, width_px=8, height_px=6)
    return _recorded(info, stereo), _recorded(info, [each for each in stereo if not isinstance(each, StereoFrame)])


def _recorded(info: RecordingInfo, messages: list[Recordable]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "walk.mcap"
        recorder = Recorder(path, info)
        for message in messages:
            recorder.offer(message)
            recorder.drain(timeout_s=0.0)
        recorder.close()
        return path.read_bytes()


@cache
def platform() -> PlatformRecording:
    """Return a second and a half of the platform with a foot."""
    run = simulate(RunSettings(rig=Rig(foot=FOOT), duration_s=1.5), seed=9)
    return measured(run, noise=None, plate=PLATE)


@cache
def platform_files() -> dict[str, bytes]:
    """Return the files of `platform`, thinned to 70 rows a second."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        platform().save(folder)
        files = {path.name: path.read_bytes() for path in folder.iterdir()}
    return {
        name: _thinned(data, 5) if name.endswith(".csv") else data.replace(b"350.0", b"70.0")
        for name, data in files.items()
    }


@cache
def trial_files() -> dict[str, bytes]:
    """Return the folder of a short trial of an ankle."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run = ankle.walk(person(5), [Perturbation.RANDOM, Perturbation.NONE], 5, slope_deg=5.0)
        save_trial(folder, ankle_measured.measured(run, ankle_measured.AnkleNoise(), 5))
        return {path.name: path.read_bytes() for path in folder.iterdir()}


def _thinned(table: bytes, step: int) -> bytes:
    header, *rows = table.splitlines()
    return b"\n".join((header, *rows[::step])) + b"\n"


@cache
def c3d_layout() -> bytes:
    """Return the layout of `c3d_files`."""
    markers = "\n".join(f"{name} = {list(place)}" for name, place in _MARKERS.items())
    text = platform_files()["platform.toml"].decode()
    return f"{text}\n[c3d]\nchannels = {list(_CHANNELS)}\n[c3d.plate_markers]\n{markers}\n".replace(
        "present = true", "present = false"
    ).encode()


@cache
def c3d_files() -> tuple[bytes, ...]:
    """Return a C3D file with three markers and a force plate."""
    import ezc3d

    recording = platform()
    file = ezc3d.c3d()
    point, analog = file["parameters"]["POINT"], file["parameters"]["ANALOG"]
    point["RATE"]["value"], point["UNITS"]["value"], point["LABELS"]["value"] = [70.0], ["m"], list(_MARKERS)
    analog["RATE"]["value"], analog["LABELS"]["value"] = [70.0], list(_CHANNELS)
    analog["UNITS"]["value"] = ["N"] * 3 + ["Nm"] * 3
    places = np.array(list(_MARKERS.values())) + recording.plate.p_m[::5, None]
    file["data"]["points"] = np.concatenate((places, np.ones((*places.shape[:2], 1))), axis=2).transpose(2, 1, 0)
    file["data"]["analogs"] = recording.wrench[::5].T[None]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trial.c3d"
        file.write(str(path))
        return (path.read_bytes(),)


_MARKERS = {"P1": (0.2, 0.0, 0.1), "P2": (-0.2, 0.0, 0.1), "P3": (-0.2, 0.0, -0.1)}
_CHANNELS = ("Fx1", "Fy1", "Fz1", "Mx1", "My1", "Mz1")
