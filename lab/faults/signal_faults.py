"""Faults of the IMU's samples: wrong values without any error on the bus."""

import itertools
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lab.faults.fault import MOTION_FLAG_S, Expect, Fault, HardwareAction, Layer
from sim_rig.imu.mpu6050_chip import Mpu6050Chip

Counts = NDArray[np.int16]
Distortion = Callable[[Counts], Counts]
"""Turns counts (n, 7), accelerometer xyz, temperature, gyroscope xyz, into what the registers show."""

_AXES = {"accel-x": 0, "accel-y": 1, "accel-z": 2, "gyro-x": 4, "gyro-y": 5, "gyro-z": 6}
_TEMPERATURE = 3
_LSB_PER_G, _LSB_PER_DEG_PER_S, _LSB_PER_DEGC = 8192, 65.5, 340
"""At the driver's own ranges, ±4 g and ±500 °/s."""


def _affine(column: int, scale: float, offset: float = 0.0) -> Distortion:
    """Return counts whose `column` reads `scale` times itself plus `offset`."""

    def distort(counts: Counts) -> Counts:
        changed: Counts = counts.copy()
        changed[:, column] = np.clip(np.rint(scale * counts[:, column] + offset), -32768, 32767)
        return changed

    return distort


def _swapped(counts: Counts) -> Counts:
    exchanged: Counts = counts[:, (1, 0, 2, 3, 5, 4, 6)]
    return exchanged


def _saturated(counts: Counts) -> Counts:
    changed: Counts = counts.copy()
    changed[:, :3] = np.where(counts[:, :3] < 0, -32768, 32767)
    return changed


def _repeated(times: int) -> Distortion:
    """Return a chip that shows each sample `times` times."""
    taken = itertools.count()
    shown: list[Counts] = []

    def distort(counts: Counts) -> Counts:
        changed: Counts = counts.copy()
        for place, sample in enumerate(counts):
            if next(taken) % times == 0 or not shown:
                shown[:] = [sample.copy()]
            changed[place] = shown[0]
        return changed

    return distort


def _warming() -> Distortion:
    """Return an accelerometer that warms by 40 °C within 4 s; its biases follow the temperature, 1 mg/°C on x and z.

    That is more than the data sheet's zero-g change, ±35 mg (x, y) and ±60 mg (z) from 0 to 70 °C.
    """
    began_s = time.monotonic()

    def distort(counts: Counts) -> Counts:
        warmer_degC = min(10.0 * (time.monotonic() - began_s), 40.0)
        bias_lsb = 0.001 * _LSB_PER_G * warmer_degC
        for column, offset in ((0, bias_lsb), (2, bias_lsb), (_TEMPERATURE, _LSB_PER_DEGC * warmer_degC)):
            counts = _affine(column, 1.0, offset)(counts)
        return counts

    return distort


def _creeping() -> Distortion:
    """Return an accelerometer whose x bias grows by 0.02 g a second."""
    began_s = time.monotonic()
    return lambda counts: _affine(0, 1.0, 0.02 * _LSB_PER_G * (time.monotonic() - began_s))(counts)


def _distorting(make: Callable[[], Distortion]) -> HardwareAction:
    def set_to(distortion: Distortion | None) -> Callable[[Mpu6050Chip], None]:
        def act(chip: Mpu6050Chip) -> None:
            chip.distortion = distortion

        return act

    return HardwareAction(
        lambda hardware: hardware.chip.do(set_to(make())), lambda hardware: hardware.chip.do(set_to(None))
    )


def _contradiction(name: str, how: str, make: Callable[[], Distortion]) -> Fault:
    return Fault(
        name=name,
        layer=Layer.IMU,
        how=how,
        act=_distorting(make),
        expect=Expect.FLAGGED,
        limit_s=MOTION_FLAG_S,
        hold_s=6.0,
        in_motion=True,
        touches="counts",
    )


def _flip(axis: str, column: int) -> Fault:
    return _contradiction(f"imu-flip-{axis}", f"{axis} has the wrong sign", lambda: _affine(column, -1.0))


SIGNAL_FAULTS = (
    *(_flip(axis, column) for axis, column in _AXES.items()),
    _contradiction("imu-axes-swapped", "the x and y axes of both sensors are exchanged", lambda: _swapped),
    _contradiction("imu-gyro-scale", "gyro-y reads 1.5 times the true rate", lambda: _affine(5, 1.5)),
    _contradiction(
        "imu-accel-bias-jump", "the bias of accel-x jumps by 0.1 g", lambda: _affine(0, 1.0, 0.1 * _LSB_PER_G)
    ),
    Fault(
        name="imu-gyro-bias-jump",
        layer=Layer.IMU,
        how="the bias of gyro-y jumps by 5 °/s",
        act=_distorting(lambda: _affine(5, 1.0, 5.0 * _LSB_PER_DEG_PER_S)),
        expect=Expect.HONEST,
        hold_s=6.0,
        in_motion=True,
        reason="the attitude filter estimates the bias: it corrects the jump or marks its output invalid",
        touches="counts",
    ),
    Fault(
        name="imu-accel-bias-creeps",
        layer=Layer.IMU,
        how="the bias of accel-x grows by 0.02 g a second for 5 s",
        act=_distorting(_creeping),
        expect=Expect.HONEST,
        hold_s=5.0,
        in_motion=True,
        reason="the accelerometer alone cannot tell it from a slow tilt; the camera's motion and the gyroscope can",
        touches="counts",
    ),
    Fault(
        name="imu-accel-warming",
        layer=Layer.IMU,
        how="the chip warms by 40 °C within 4 s, and accel-x and accel-z are off by 1 mg/°C",
        act=_distorting(_warming),
        expect=Expect.HONEST,
        hold_s=6.0,
        in_motion=True,
        reason="as slow as a tilt; the camera's motion and the gyroscope carry the vertical",
        touches="counts",
    ),
    Fault(
        name="imu-samples-doubled",
        layer=Layer.IMU,
        how="the chip delivers each sample twice",
        act=_distorting(lambda: _repeated(2)),
        expect=Expect.HONEST,
        hold_s=4.0,
        in_motion=True,
        reason="5 ms late on the average, within the stated uncertainty; the steps may be too much for the filter",
        touches="counts",
    ),
    _contradiction("imu-samples-repeated", "the chip delivers each sample ten times", lambda: _repeated(10)),
    Fault(
        name="imu-clipped",
        layer=Layer.IMU,
        how="all three accelerations saturate for 0.5 s, as in a hard impact",
        act=_distorting(lambda: _saturated),
        expect=Expect.HONEST,
        hold_s=0.5,
        reason="clipped samples are recognised; the gyroscope carries the attitude meanwhile",
        touches="counts",
    ),
    Fault(
        name="imu-temperature-jump",
        layer=Layer.IMU,
        how="the chip's temperature reads 30 °C higher from one sample to the next",
        act=_distorting(lambda: _affine(_TEMPERATURE, 1.0, 30.0 * _LSB_PER_DEGC)),
        expect=Expect.TOLERATED,
        reason="temperature is reported, not used",
        touches="counts",
    ),
)
