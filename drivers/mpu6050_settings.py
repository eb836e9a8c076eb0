"""How an MPU-6050 is set up, checked when it is made, and what that means for its registers."""

import math
from dataclasses import dataclass

from drivers.mpu6050_registers import (
    ACCEL_RANGES,
    FILTER_ROWS,
    GYRO_RANGES,
    INTERNAL_RATE_HZ,
    STANDARD_GRAVITY_MPS2,
    FifoEnable,
    FilterRow,
    Interrupt,
    Power,
    Register,
)

_FIFO_CONTENT = FifoEnable.ACCEL | FifoEnable.TEMPERATURE | FifoEnable.GYRO_X | FifoEnable.GYRO_Y | FifoEnable.GYRO_Z
_RATES_HZ = (4, 500)


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
        filtered = [row.code for row in FILTER_ROWS.values() if row.rate_hz == INTERNAL_RATE_HZ]
        for field, allowed in (
            ("accel_range_g", list(ACCEL_RANGES)),
            ("gyro_range_deg_per_s", list(GYRO_RANGES)),
            ("filter_row", filtered),
        ):
            if getattr(self, field) not in allowed:
                raise ValueError(f"{field} is {getattr(self, field)}, must be one of {allowed}")


@dataclass(frozen=True)
class Configuration:
    """The settings as register values and factors."""

    registers: tuple[tuple[Register, int], ...]
    mps2_per_lsb: float
    radps_per_lsb: float
    filter_row: FilterRow
    period_s: float


def configure(settings: Mpu6050Settings) -> Configuration:
    """Return the register values, in the order in which they are written, and the factors for these settings."""
    accel = ACCEL_RANGES[settings.accel_range_g]
    gyro = GYRO_RANGES[settings.gyro_range_deg_per_s]
    return Configuration(
        registers=(
            (Register.SMPLRT_DIV, INTERNAL_RATE_HZ // settings.rate_hz - 1),
            (Register.CONFIG, settings.filter_row),
            (Register.GYRO_CONFIG, gyro.register_value),
            (Register.ACCEL_CONFIG, accel.register_value),
            (Register.INT_PIN_CFG, 0),
            (Register.INT_ENABLE, Interrupt.DATA_READY | Interrupt.FIFO_OVERFLOW),
            (Register.FIFO_EN, _FIFO_CONTENT),
            (Register.PWR_MGMT_1, Power.PLL_GYRO_X),
        ),
        mps2_per_lsb=STANDARD_GRAVITY_MPS2 / accel.lsb_per_unit,
        radps_per_lsb=math.radians(1.0) / gyro.lsb_per_unit,
        filter_row=FILTER_ROWS[settings.filter_row],
        period_s=1.0 / settings.rate_hz,
    )
