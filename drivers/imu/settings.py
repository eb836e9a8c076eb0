"""How an MPU-6050 is set up, checked when it is made, and what that means for its registers."""

import math
from dataclasses import dataclass

from drivers.imu.chips import CHIPS, MPU6050_WHO_AM_I, ChipModel, FilterRow
from drivers.imu.registers import (
    ACCEL_RANGES,
    GYRO_RANGES,
    INTERNAL_RATE_HZ,
    FifoEnable,
    Interrupt,
    Power,
    Register,
)
from messages.constants import STANDARD_GRAVITY_MPS2

_FIFO_CONTENT = FifoEnable.ACCEL | FifoEnable.TEMPERATURE | FifoEnable.GYRO_X | FifoEnable.GYRO_Y | FifoEnable.GYRO_Z
_RATES_HZ = (4, 500)
_FROZEN_FRAMES = 4
_LIVELY_BANDWIDTH = 0.4


@dataclass(frozen=True)
class Mpu6050Settings:
    """How the chip is set up: sample rate, full-scale ranges in g and °/s, and row of the low-pass filter.

    Raises ValueError naming the field and what it may be.
    """

    rate_hz: int = 100
    accel_range_g: int = 4
    gyro_range_deg_per_s: int = 500
    filter_row: int = 3

    def __post_init__(self) -> None:
        lowest, highest = _RATES_HZ
        if not lowest <= self.rate_hz <= highest or INTERNAL_RATE_HZ % self.rate_hz:
            raise ValueError(f"rate_hz is {self.rate_hz}, must divide {INTERNAL_RATE_HZ} and be {lowest} to {highest}")
        rows = CHIPS[MPU6050_WHO_AM_I].filter_rows.values()  # the codes are the same in all of them
        filtered = [row.code for row in rows if row.rate_hz == INTERNAL_RATE_HZ]
        for field, allowed in (
            ("accel_range_g", list(ACCEL_RANGES)),
            ("gyro_range_deg_per_s", list(GYRO_RANGES)),
            ("filter_row", filtered),
        ):
            if getattr(self, field) not in allowed:
                raise ValueError(f"{field} is {getattr(self, field)}, must be one of {allowed}")


@dataclass(frozen=True)
class Configuration:
    """The settings on one chip, as register values and factors.

    `frozen_frames` is how many identical frames in a row no living chip gives: its noise changes them.
    """

    chip: ChipModel
    registers: tuple[tuple[Register, int], ...]
    mps2_per_lsb: float
    radps_per_lsb: float
    filter_row: FilterRow
    period_s: float
    frozen_frames: int


def configure(settings: Mpu6050Settings, chip: ChipModel = CHIPS[MPU6050_WHO_AM_I]) -> Configuration:
    """Return the register values, in the order in which they are written, and the factors for these settings."""
    accel = ACCEL_RANGES[settings.accel_range_g]
    gyro = GYRO_RANGES[settings.gyro_range_deg_per_s]
    row = chip.filter_rows[settings.filter_row]
    own_filter = ((Register.ACCEL_CONFIG_2, chip.accel_config_2 | row.code),) if chip.has_accel_filter else ()
    return Configuration(
        chip=chip,
        registers=(
            (Register.SMPLRT_DIV, INTERNAL_RATE_HZ // settings.rate_hz - 1),
            (Register.CONFIG, row.code),
            (Register.GYRO_CONFIG, gyro.register_value),
            (Register.ACCEL_CONFIG, accel.register_value),
            *own_filter,
            (Register.INT_PIN_CFG, 0),
            (Register.INT_ENABLE, Interrupt.DATA_READY | Interrupt.FIFO_OVERFLOW),
            (Register.FIFO_EN, _FIFO_CONTENT),
            (Register.PWR_MGMT_1, Power.PLL_GYRO_X),
            (Register.PWR_MGMT_2, 0),
        ),
        mps2_per_lsb=STANDARD_GRAVITY_MPS2 / accel.lsb_per_unit,
        radps_per_lsb=math.radians(1.0) / gyro.lsb_per_unit,
        filter_row=row,
        period_s=1.0 / settings.rate_hz,
        frozen_frames=_frozen_frames(settings.rate_hz, row),
    )


def _frozen_frames(rate_hz: int, row: FilterRow) -> int:
    """A slow filter correlates the noise of neighbouring samples, so more of them may happen to be equal."""
    return math.ceil(_FROZEN_FRAMES * max(1.0, _LIVELY_BANDWIDTH * rate_hz / row.gyro_bandwidth_hz))
