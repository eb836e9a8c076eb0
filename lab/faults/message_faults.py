"""Faults as changes of the stream of messages: what arrives from the IMU, what from the camera.

Each is drawn: an axis, a direction, an eye, a sign. A `Kind` says what is drawn, whether the frames leave the question
of the ground answerable meanwhile, and, where nothing could tell, why.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from lab.faults import deformed_view, image_changes
from lab.faults.faulty_camera import ImageChange
from lab.faults.offline import Message, MessageFault, pictures
from messages import ImuSample, StereoCalibration, StereoFrame, Vec3, vec3
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2

Draw = Callable[[np.random.Generator, StereoCalibration], MessageFault]
SampleChange = Callable[[ImuSample, float], Sequence[ImuSample]]
FrameChange = Callable[[StereoFrame, float], Sequence[StereoFrame]]


@dataclass(frozen=True)
class Kind:
    """One kind of fault. `answerable` says that IMU and camera together still tell the ground while it lasts;
    `undetectable` is the argument why nothing that the unit measures could show it, empty where something could."""

    of: str
    draw: Draw
    answerable: bool = False
    undetectable: str = ""


def _of_samples(change: SampleChange) -> MessageFault:
    def fault(message: Message, since_s: float) -> Sequence[Message]:
        return change(message, since_s) if isinstance(message, ImuSample) else (message,)

    return fault


def _of_frames(change: FrameChange) -> MessageFault:
    def fault(message: Message, since_s: float) -> Sequence[Message]:
        return change(message, since_s) if isinstance(message, StereoFrame) else (message,)

    return fault


def _direction(chance: np.random.Generator) -> FloatArray:
    towards = chance.standard_normal(3)
    unit: FloatArray = towards / np.linalg.norm(towards)
    return unit


def _moved(before: Vec3, by: FloatArray) -> Vec3:
    return vec3(np.add(before, by))


def _gyro_bias(dps: float, within_s: float) -> Draw:
    """A bias of the gyroscope that steps, or grows `within_s`, to `dps` in some direction."""

    def draw(chance: np.random.Generator, _stereo: StereoCalibration) -> MessageFault:
        bias = math.radians(dps) * _direction(chance)

        def change(sample: ImuSample, since_s: float) -> Sequence[ImuSample]:
            grown = min(1.0, since_s / within_s) if within_s else 1.0
            return (msgspec.structs.replace(sample, w_WB_B_radps=_moved(sample.w_WB_B_radps, grown * bias)),)

        return _of_samples(change)

    return draw


def _accelerometer_bias(g: float, within_s: float = 0.0, warming_K: float = 0.0) -> Draw:
    """A bias of the accelerometer that steps, or grows `within_s`, to `g` in some direction, as the die warms up."""

    def draw(chance: np.random.Generator, _stereo: StereoCalibration) -> MessageFault:
        bias = g * STANDARD_GRAVITY_MPS2 * _direction(chance)

        def change(sample: ImuSample, since_s: float) -> Sequence[ImuSample]:
            grown = min(1.0, since_s / within_s) if within_s else 1.0
            warmer_degC = sample.temperature_degC + grown * warming_K
            sf_B_mps2 = _moved(sample.sf_B_mps2, grown * bias)
            return (msgspec.structs.replace(sample, sf_B_mps2=sf_B_mps2, temperature_degC=warmer_degC),)

        return _of_samples(change)

    return draw


def _times(*, gyro: FloatArray | None = None, accelerometer: FloatArray | None = None) -> MessageFault:
    """Samples multiplied axis by axis, each factor (3,)."""

    def change(sample: ImuSample, _since_s: float) -> Sequence[ImuSample]:
        rate = sample.w_WB_B_radps if gyro is None else vec3(np.multiply(gyro, sample.w_WB_B_radps))
        force = sample.sf_B_mps2 if accelerometer is None else vec3(np.multiply(accelerometer, sample.sf_B_mps2))
        return (msgspec.structs.replace(sample, w_WB_B_radps=rate, sf_B_mps2=force),)

    return _of_samples(change)


def _range_flipped(sensor: str, factor: float) -> Draw:
    return lambda _chance, _stereo: _times(**{sensor: np.full(3, factor)})


def _axis_flipped(sensor: str) -> Draw:
    def draw(chance: np.random.Generator, _stereo: StereoCalibration) -> MessageFault:
        factors = np.ones(3)
        factors[chance.integers(3)] = -1.0
        return _times(**{sensor: factors})

    return draw


def _bursts(chance: np.random.Generator, longest_s: float) -> Callable[[float], bool]:
    """Return whether a time since the beginning lies in one of the bursts, each up to `longest_s`, 0.2 to 0.6 s
    apart."""
    begins_s = np.cumsum(chance.uniform(0.2, 0.6, 60))
    lasts_s = chance.uniform(0.02, longest_s, 60)

    def inside(since_s: float) -> bool:
        k = int(np.searchsorted(begins_s, since_s, side="right")) - 1
        return k >= 0 and since_s < begins_s[k] + lasts_s[k]

    return inside


def _samples_lost(chance: np.random.Generator, _stereo: StereoCalibration) -> MessageFault:
    lost = _bursts(chance, 0.12)
    return _of_samples(lambda sample, since_s: () if lost(since_s) else (sample,))


def _samples_late(chance: np.random.Generator, _stereo: StereoCalibration) -> MessageFault:
    held_up = _bursts(chance, 0.12)

    def change(sample: ImuSample, since_s: float) -> Sequence[ImuSample]:
        late_ns = 60_000_000 if held_up(since_s) else 0
        return (msgspec.structs.replace(sample, t_arrival_ns=sample.t_arrival_ns + late_ns),)

    return _of_samples(change)


def _samples_twice(_chance: np.random.Generator, _stereo: StereoCalibration) -> MessageFault:
    return _of_samples(lambda sample, _since_s: (sample, sample))


def _samples_stuck(chance: np.random.Generator, _stereo: StereoCalibration) -> MessageFault:
    """The values of one sample again and again, with new stamps."""
    sticks, kept = _bursts(chance, 0.15), list[ImuSample]()

    def change(sample: ImuSample, since_s: float) -> Sequence[ImuSample]:
        if not sticks(since_s):
            kept[:] = [sample]
        still = kept[0] if kept else sample
        values = {name: getattr(still, name) for name in ("w_WB_B_radps", "sf_B_mps2")}
        return (msgspec.structs.replace(sample, **values),)

    return _of_samples(change)


def _samples_frozen(_chance: np.random.Generator, _stereo: StereoCalibration) -> MessageFault:
    first: list[ImuSample] = []

    def change(sample: ImuSample, _since_s: float) -> Sequence[ImuSample]:
        first.append(first[0] if first else sample)
        values = {name: getattr(first[0], name) for name in ("w_WB_B_radps", "sf_B_mps2")}
        return (msgspec.structs.replace(sample, **values),)

    return _of_samples(change)


def _clock_steps(chance: np.random.Generator, _stereo: StereoCalibration) -> MessageFault:
    """The IMU's stamps are off by 10 to 100 ms, either way."""
    by_ns = round(float(chance.choice([-1.0, 1.0])) * chance.uniform(10e6, 100e6))

    def change(sample: ImuSample, _since_s: float) -> Sequence[ImuSample]:
        return (msgspec.structs.replace(sample, t_sample_ns=sample.t_sample_ns + by_ns),)

    return _of_samples(change)


def _silent_imu(_chance: np.random.Generator, _stereo: StereoCalibration) -> MessageFault:
    return _of_samples(lambda _sample, _since_s: ())


def _shown(make: Callable[[], ImageChange]) -> Draw:
    return lambda _chance, _stereo: pictures(make())


def _one_black(chance: np.random.Generator, _stereo: StereoCalibration) -> MessageFault:
    left = bool(chance.integers(2))
    return pictures(image_changes.black(left=left, right=not left))


def _turned(least_deg: float, most_deg: float) -> Draw:
    """Both cameras turned on their mount, in pitch and roll together by so much."""

    def draw(chance: np.random.Generator, _stereo: StereoCalibration) -> MessageFault:
        by_deg, way = chance.uniform(least_deg, most_deg), chance.uniform(0.0, math.tau)
        return pictures(image_changes.turned(by_deg * math.cos(way), by_deg * math.sin(way)))

    return draw


def _right_shifted(rows_px: float, columns_px: float) -> Draw:
    """The right eye slipped by so many px, either way."""

    def draw(chance: np.random.Generator, _stereo: StereoCalibration) -> MessageFault:
        sign = 1 if chance.integers(2) else -1
        return pictures(image_changes.right_shifted(sign * round(rows_px), sign * round(columns_px)))

    return draw


def _deformed(kind: str, size: str = "") -> Draw:
    def draw(chance: np.random.Generator, stereo: StereoCalibration) -> MessageFault:
        change, _ = deformed_view.drawn(kind, size, chance, stereo)
        return pictures(change)

    return draw


def _frames_lost(keeps: int) -> Draw:
    """Of each `keeps` frames one arrives, none for 0."""
    return lambda _chance, _stereo: _of_frames(
        lambda frame, _since_s: (frame,) if keeps and frame.header.seq % keeps == 0 else ()
    )


def _frame(frame: StereoFrame, *, stamp_s: float = 0.0, arrival_s: float = 0.0) -> StereoFrame:
    header = frame.header
    moved = msgspec.structs.replace(
        header,
        t_exposure_ns=header.t_exposure_ns + round(1e9 * stamp_s),
        t_arrival_ns=header.t_arrival_ns + round(1e9 * arrival_s),
    )
    return msgspec.structs.replace(frame, header=moved)


def _stamped(by_s: float) -> Draw:
    """Frames stamped so much later than they were taken, or earlier."""

    def draw(chance: np.random.Generator, _stereo: StereoCalibration) -> MessageFault:
        sign = 1.0 if chance.integers(2) else -1.0
        return _of_frames(lambda frame, _since_s: (_frame(frame, stamp_s=sign * by_s),))

    return draw


def _arriving(by_s: float) -> Draw:
    return lambda _chance, _stereo: _of_frames(lambda frame, _since_s: (_frame(frame, arrival_s=by_s),))


_TILT = "an acceleration that is off so slowly turns the vertical as a tilt of all that is walked on would: the steps' \
travel tells differences of acceleration within a second, gravity and bias only in sum until the unit turns"
_MOUNT = "turns of up to 3° in the mount change what the IMU should see of a turn by 5 % of it and of a travel by its \
cosine: the vertical in the camera is known by the mount alone, and ground of another slope looks the same"

IMU_KINDS: dict[str, Kind] = {
    **{f"gyro-step-{dps:g}": Kind("imu", _gyro_bias(dps, 0.0), answerable=True) for dps in (0.8, 2, 5)},
    **{f"gyro-drift-{dps:g}": Kind("imu", _gyro_bias(dps, 3.0), answerable=True) for dps in (0.8, 2, 5)},
    "gyro-double": Kind("imu", _range_flipped("gyro", 2.0)),
    "gyro-half": Kind("imu", _range_flipped("gyro", 0.5)),
    "gyro-flipped": Kind("imu", _axis_flipped("gyro")),
    "accel-step-0.03": Kind("imu", _accelerometer_bias(0.03)),
    "accel-step-0.1": Kind("imu", _accelerometer_bias(0.1)),
    "accel-warm": Kind("imu", _accelerometer_bias(0.04, 4.0, 30.0), answerable=True),
    "accel-creeps": Kind("imu", _accelerometer_bias(0.08, 4.0), undetectable=_TILT),
    "accel-double": Kind("imu", _range_flipped("accelerometer", 2.0)),
    "accel-half": Kind("imu", _range_flipped("accelerometer", 0.5)),
    "accel-flipped": Kind("imu", _axis_flipped("accelerometer")),
    "samples-lost": Kind("imu", _samples_lost),
    "samples-late": Kind("imu", _samples_late),
    "samples-twice": Kind("imu", _samples_twice, answerable=True),
    "samples-stuck": Kind("imu", _samples_stuck),
    "samples-frozen": Kind("imu", _samples_frozen),
    "clock-steps": Kind("imu", _clock_steps),
    "imu-silent": Kind("imu", _silent_imu),
}
"""Faults of the IMU by name; the number of a bias is in °/s or in standard gravity."""

CAMERA_KINDS: dict[str, Kind] = {
    "right-late": Kind("camera", _shown(image_changes.right_late)),
    "swapped": Kind("camera", _shown(image_changes.swapped)),
    "black": Kind("camera", _shown(lambda: image_changes.black(left=True, right=True))),
    "white": Kind("camera", _shown(lambda: image_changes.exposed(60.0))),
    "frozen": Kind("camera", _shown(image_changes.frozen)),
    "frozen-noisy": Kind("camera", _shown(image_changes.frozen_but_noisy)),
    "one-black": Kind("camera", _one_black),
    "no-texture": Kind("camera", _shown(image_changes.textureless)),
    "fading": Kind("camera", _shown(lambda: image_changes.darkening(0.937))),
    "frames-gone": Kind("camera", _frames_lost(0)),
    "frames-halved": Kind("camera", _frames_lost(2), answerable=True),
    "frames-late": Kind("camera", _arriving(0.08), answerable=True),
    "frames-early": Kind("camera", _arriving(-0.015)),
    "torn": Kind("camera", _shown(image_changes.torn)),
    **{f"stamps-off-{ms}": Kind("camera", _stamped(1e-3 * ms)) for ms in (20, 50, 200)},
    "camera-turned": Kind("camera", _turned(1.0, 3.0), undetectable=_MOUNT),
    "camera-turned-15": Kind("camera", _turned(15.0, 15.0)),
    "slipped-rows": Kind("camera", _right_shifted(4, 0)),
    "slipped-columns": Kind("camera", _right_shifted(0, 4)),
    "drop-2": Kind("camera", _deformed("drop", "2")),
    "bent-1": Kind("camera", _deformed("bent", "1")),
    "stretched-2": Kind("camera", _deformed("stretched", "2")),
    "blur-9": Kind("camera", _deformed("blur", "9")),
    "blur-25": Kind("camera", _deformed("blur", "25")),
    "dirt": Kind("camera", _deformed("dirt")),
    "half-covered": Kind("camera", _deformed("half")),
    "mirrored": Kind("camera", _deformed("mirrored")),
    "upside-down": Kind("camera", _deformed("upside")),
}
"""Faults of the camera by name; numbers are px of the raw picture, degrees or ms."""

KINDS = IMU_KINDS | CAMERA_KINDS
OUT_OF_ORDER = (
    *("right-late", "swapped", "black", "white", "frozen", "frozen-noisy", "one-black", "no-texture", "fading"),
    *("frames-gone", "stamps-off-50", "slipped-rows", "camera-turned-15", "torn", "blur-9", "half-covered", "mirrored"),
)
"""Faults of the camera that leave it nothing sound to say of the motion, or little."""
