"""Self-test of an MPU-6050 or a relative: does an electrical push on each axis do what it did in the factory?

    response = mean with the push − mean without it        change = (response − factory trim) / factory trim

Sources: RM-MPU-6000A section 4.1 (MPU-6050: ±8 g, ±250 °/s, passed within ±14 %); AN-MPU-6500A-02 (the others: ±2 g,
±250 °/s; gyroscope passed above half the factory's, accelerometer between half and one and a half of it; where the
factory left no code, 60 °/s at least and 225 to 675 mg).
"""

from collections.abc import Callable
from dataclasses import dataclass

import msgspec
import numpy as np

from drivers.imu.chips import ChipModel
from drivers.imu.frames import FRAME
from drivers.imu.register_access import RegisterAccess
from drivers.imu.registers import ACCEL_RANGES, GYRO_RANGES, SELF_TEST_ALL_AXES, RangeRow, Register
from drivers.protocols import DeviceError
from messages.arrays import FloatArray

AXES = ("accelerometer x", "accelerometer y", "accelerometer z", "gyroscope x", "gyroscope y", "gyroscope z")

_FILTER_ROW = 2
_DIVIDER = 4  # 200 Hz
_SAMPLE_S = 0.006
_SAMPLES = 60
_SETTLING_S = 0.15
_REST_STD_G, _REST_STD_DEG_PER_S = 0.03, 1.0
_REST_SHIFT_G, _REST_SHIFT_DEG_PER_S = 0.05, 2.0
_MPU6050_TOLERANCE = 0.14


class AxisTest(msgspec.Struct, frozen=True, kw_only=True):
    """One axis, in counts at the range of the test; `change_share` is NaN where the factory left no trim code."""

    axis: str
    response_lsb: float
    factory_trim_lsb: float
    change_share: float
    passed: bool


class SelfTest(msgspec.Struct, frozen=True, kw_only=True):
    """All six axes, accelerometer first, and whether all of them passed."""

    chip: str
    axes: tuple[AxisTest, ...]
    passed: bool


@dataclass(frozen=True)
class TrimCodes:
    """What the factory wrote into the self-test registers, per axis x, y, z; 0 is no code."""

    accel: tuple[int, int, int]
    gyro: tuple[int, int, int]

    def registers(self, chip: ChipModel) -> dict[int, int]:
        """Return the registers that hold these codes in this chip."""
        first, accel, gyro = Register.SELF_TEST_X, self.accel, self.gyro
        if not chip.shares_trim_registers:
            return {
                **{first + axis: code for axis, code in enumerate(accel)},
                **{Register.SELF_TEST_X_GYRO + axis: code for axis, code in enumerate(gyro)},
            }
        high = {first + axis: (accel[axis] >> 2) << 5 | gyro[axis] for axis in range(3)}
        return {**high, first + 3: (accel[0] & 3) << 4 | (accel[1] & 3) << 2 | accel[2] & 3}


def read_trim_codes(access: RegisterAccess, chip: ChipModel) -> TrimCodes:
    """Return the factory's codes. Raises OSError."""
    if not chip.shares_trim_registers:
        accel, gyro = access.read(Register.SELF_TEST_X, 3), access.read(Register.SELF_TEST_X_GYRO, 3)
        return TrimCodes((accel[0], accel[1], accel[2]), (gyro[0], gyro[1], gyro[2]))
    x, y, z, low = access.read(Register.SELF_TEST_X, 4)
    return TrimCodes(
        (x >> 5 << 2 | low >> 4 & 3, y >> 5 << 2 | low >> 2 & 3, z >> 5 << 2 | low & 3),
        (x & 0x1F, y & 0x1F, z & 0x1F),
    )


def ranges_under_test(chip: ChipModel) -> tuple[RangeRow, RangeRow]:
    """Return the accelerometer's and the gyroscope's range in which the chip is tested."""
    return ACCEL_RANGES[8 if chip.shares_trim_registers else 2], GYRO_RANGES[250]


def factory_trim_lsb(chip: ChipModel, codes: TrimCodes) -> tuple[float, ...]:
    """Return the factory's responses (6,) in counts, accelerometer first; 0 where there is no code."""
    if not chip.shares_trim_registers:
        return tuple(2620.0 * 1.01 ** (code - 1) if code else 0.0 for code in codes.accel + codes.gyro)
    accel = (4096.0 * 0.34 * (0.92 / 0.34) ** ((code - 1) / 30.0) if code else 0.0 for code in codes.accel)
    gyro = (25.0 * 131.0 * 1.046 ** (code - 1) if code else 0.0 for code in codes.gyro)
    x, y, z = gyro
    return (*accel, x, -y, z)


def run_self_test(access: RegisterAccess, chip: ChipModel, sleep: Callable[[float], None]) -> SelfTest:
    """Test all axes at once, in about two seconds; the chip is left in the ranges of the test.

    Raises DeviceError if the unit was not at rest, OSError if a transfer failed.
    """
    codes = read_trim_codes(access, chip)
    before = _measure(access, chip, 0, sleep)
    pushed = _measure(access, chip, SELF_TEST_ALL_AXES, sleep)
    after = _measure(access, chip, 0, sleep)
    shift = np.abs(after - before)
    accel, gyro = ranges_under_test(chip)
    if np.max(shift[:3]) > _REST_SHIFT_G * accel.lsb_per_unit or (
        np.max(shift[3:]) > _REST_SHIFT_DEG_PER_S * gyro.lsb_per_unit
    ):
        raise DeviceError("IMU self-test: the unit was turned meanwhile; it must lie at rest for two seconds")
    return _judge(chip, codes, pushed - 0.5 * (before + after))


def _measure(access: RegisterAccess, chip: ChipModel, push: int, sleep: Callable[[float], None]) -> FloatArray:
    """Return the mean counts (6,), accelerometer first."""
    accel, gyro = ranges_under_test(chip)
    access.write_byte(Register.SMPLRT_DIV, _DIVIDER)
    access.write_byte(Register.CONFIG, _FILTER_ROW)
    if chip.has_accel_filter:
        access.write_byte(Register.ACCEL_CONFIG_2, chip.accel_config_2 | _FILTER_ROW)
    access.write_byte(Register.ACCEL_CONFIG, push | accel.register_value)
    access.write_byte(Register.GYRO_CONFIG, push | gyro.register_value)
    sleep(_SETTLING_S)
    rows = []
    for _ in range(_SAMPLES):
        sleep(_SAMPLE_S)
        rows.append(FRAME.unpack(access.read(Register.ACCEL_XOUT_H, FRAME.size)))
    counts = np.array(rows, dtype=np.float64)[:, [0, 1, 2, 4, 5, 6]]
    unrest = np.std(counts, axis=0)
    worst_g = float(np.max(unrest[:3])) / accel.lsb_per_unit
    worst_deg_per_s = float(np.max(unrest[3:])) / gyro.lsb_per_unit
    if worst_g > _REST_STD_G or worst_deg_per_s > _REST_STD_DEG_PER_S:
        raise DeviceError(
            f"IMU self-test: the unit moves (deviation {worst_g:.3f} g and {worst_deg_per_s:.1f} °/s, "
            f"allowed {_REST_STD_G} g and {_REST_STD_DEG_PER_S} °/s); it must lie at rest for two seconds"
        )
    mean: FloatArray = np.mean(counts, axis=0)
    return mean


def _judge(chip: ChipModel, codes: TrimCodes, response: FloatArray) -> SelfTest:
    trims = factory_trim_lsb(chip, codes)
    has_all = {"a": all(codes.accel), "g": all(codes.gyro)}
    axes = tuple(
        _judge_axis(chip, name, float(value), trim, has_all[name[0]])
        for name, value, trim in zip(AXES, response, trims, strict=True)
    )
    return SelfTest(chip=chip.name, axes=axes, passed=all(axis.passed for axis in axes))


def _judge_axis(chip: ChipModel, name: str, response_lsb: float, trim_lsb: float, has_codes: bool) -> AxisTest:
    change = (response_lsb - trim_lsb) / trim_lsb if trim_lsb else float("nan")
    if chip.shares_trim_registers:
        passed = abs(change) <= _MPU6050_TOLERANCE
    elif has_codes:
        passed = change > -0.5 if name.startswith("g") else abs(change) < 0.5
    else:
        passed = _is_within_absolute_limits(chip, name, response_lsb)
    return AxisTest(
        axis=name, response_lsb=response_lsb, factory_trim_lsb=trim_lsb, change_share=change, passed=bool(passed)
    )


def _is_within_absolute_limits(chip: ChipModel, name: str, response_lsb: float) -> bool:
    accel, gyro = ranges_under_test(chip)
    if name.startswith("g"):
        return abs(response_lsb) >= 60.0 * gyro.lsb_per_unit
    return 0.225 * accel.lsb_per_unit <= response_lsb <= 0.675 * accel.lsb_per_unit
