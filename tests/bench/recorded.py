"""Messages of every kind and recordings of them, for the tests of the recorder and of its reader."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec
import numpy as np

from daemon.recorder import Recorder, RecordingInfo
from daemon.recording_file import Recordable
from messages import (
    AnkleState,
    Attitude,
    DepthFrame,
    DeviceCounters,
    DropCause,
    DroppedFrame,
    FrameHeader,
    GaitPhase,
    GroundPlane,
    GroundTruth,
    ImuSample,
    Input,
    Load,
    LoadLevel,
    Reason,
    Source,
    Status,
    StereoFrame,
    Tick,
)

NAN = math.nan
MS = 1_000_000
INFO = RecordingInfo(
    device="bench",
    source=Source.SIMULATED,
    calibration_text="unit: bench-7  # µ\n",
    configuration_text="[zenoh]\nlisten = []\n",
)


def imu(k: int, t_ns: int) -> ImuSample:
    return ImuSample(
        seq=k,
        t_sample_ns=t_ns - 5 * MS,
        t_arrival_ns=t_ns,
        sf_B_mps2=(0.1 * k, NAN if k % 7 == 0 else -1e-17, 9.80665),
        w_WB_B_radps=(1 / 3, -0.0, 2**-1074),
        temperature_degC=NAN,
        clipped=k % 5 == 0,
        lost_before=k % 3,
    )


def header(seq: int, t_ns: int, width_px: int = 32, height_px: int = 20) -> FrameHeader:
    return FrameHeader(
        seq=seq,
        t_exposure_ns=t_ns - 40 * MS,
        t_arrival_ns=t_ns,
        exposure_s=NAN,
        width_px=width_px,
        height_px=height_px,
    )


def frame(seq: int, t_ns: int, width_px: int = 32, height_px: int = 20) -> StereoFrame:
    pixels = np.random.default_rng(seq).integers(0, 256, (2, height_px, width_px), dtype=np.uint8)
    return StereoFrame(header=header(seq, t_ns, width_px, height_px), left=pixels[0], right=pixels[1])


def depth_frame(seq: int, t_ns: int, width_px: int = 32, height_px: int = 20) -> DepthFrame:
    steps = np.random.default_rng(seq).integers(0, 65536, (height_px, width_px), dtype=np.uint16)
    return DepthFrame(header=header(seq, t_ns, width_px, height_px), depth=steps)


def ground(seq: int, t_ns: int) -> GroundPlane:
    return GroundPlane.invalid(
        t_exposure_ns=t_ns,
        frame_seq=seq,
        reason=Reason.LOW_TEXTURE,
        ahead_m=NAN,
        calibration_id="0123abcd",
        matched_share=0.25,
    )


def attitude(t_ns: int) -> Attitude:
    return Attitude(
        t_sample_ns=t_ns,
        status=Status.VALID,
        reason=Reason.NONE,
        q_WB=(1.0, 0.0, 0.0, 0.0),
        w_WB_B_radps=(0.0, 0.1, 0.2),
        gyro_bias_B_radps=(0.0, 0.0, 0.0),
        rotation_cov_W_rad2=(1e-6, 0.0, 0.0, 1e-6, 0.0, NAN),
        calibration_id="0123abcd",
    )


def truth(t_exposure_ns: int) -> GroundTruth:
    return GroundTruth(
        t_exposure_ns=t_exposure_ns,
        slope_sagittal_rad=0.1,
        slope_frontal_rad=NAN,
        height_m=0.9,
        q_WB=(1.0, 0.0, 0.0, 0.0),
        kind="ramp",
        transition=False,
        standing=True,
    )


def walk(seconds: float, width_px: int = 32, height_px: int = 20, start_ns: int = 10**9) -> list[Recordable]:
    """Every kind of message, some stamps out of order, as the pipeline meets and makes them."""
    messages: list[Recordable] = []
    for k in range(round(seconds * 100)):
        t_ns = start_ns + 10 * MS * k
        messages += [imu(k, t_ns), attitude(t_ns), Tick(t_ns=t_ns - 2 * MS)]
        if k % 5 == 2 and k % 15 != 2:
            shot = frame(k // 5, t_ns - MS, width_px, height_px)
            messages += [shot, ground(k // 5, shot.header.t_exposure_ns), truth(shot.header.t_exposure_ns)]
        if k % 15 == 2:
            messages.append(DroppedFrame(header=header(k // 5, t_ns, width_px, height_px), cause=DropCause.SUPERSEDED))
        if k % 40 == 11:
            messages.append(LoadLevel(t_ns=t_ns, load=Load.REDUCED))
            messages.append(DeviceCounters(t_ns=t_ns, frames_dropped={DropCause.LATE: k}, can_errors=1))
        if k % 20 == 3:
            messages.append(
                AnkleState(
                    t_sample_ns=t_ns - 30 * MS,
                    ankle_angle_rad=NAN,
                    ankle_rate_radps=0.5,
                    load_n=700.0,
                    phase=GaitPhase.SWING,
                )
            )
    return messages


def inputs_of(messages: Iterable[Recordable]) -> list[Input]:
    return [message for message in messages if isinstance(message, Input)]


def record(path: Path, messages: Iterable[Recordable], *, last_s: float | None = None, close: bool = True) -> Recorder:
    recorder = Recorder(path, INFO, last_s=last_s)
    for message in messages:
        recorder.offer(message)
        recorder.drain(timeout_s=0.0)
    if close:
        recorder.close()
    return recorder


def facts(message: object) -> object:
    """What a message says, comparable: NaN equals NaN, pixels by value."""
    if isinstance(message, StereoFrame):
        return "StereoFrame", facts(message.header), message.left.tolist(), message.right.tolist()
    if isinstance(message, DepthFrame):
        return "DepthFrame", facts(message.header), message.depth.tolist()
    assert isinstance(message, msgspec.Struct)
    return type(message).__name__, repr(message)


def all_facts(messages: Sequence[object]) -> list[object]:
    return [facts(message) for message in messages]
