"""The MPU-6050's register map as data: what it shares with its relatives. What differs is in `drivers.imu.chips`.

Source: InvenSense MPU-6000/MPU-6050 Register Map and Descriptions (RM-MPU-6000A) and Product Specification
(PS-MPU-6000A).
"""

from dataclasses import dataclass
from enum import IntEnum

INTERNAL_RATE_HZ = 1000
INTERNAL_RATE_UNFILTERED_HZ = 8000
FIFO_BYTES = 1024
"""Of the MPU-6050 itself."""

RESET_S = 0.100  # a register can be read or written this long after power or reset
GYRO_START_S = 0.060  # and the gyroscope has started this long after waking
FILTER_SETTLING_S = 0.050


class Register(IntEnum):
    """Addresses of the registers in use."""

    SELF_TEST_X_GYRO = 0x00  # three registers, not in the MPU-6050
    SELF_TEST_X = 0x0D  # the MPU-6050's four; in the others the accelerometer's three
    SMPLRT_DIV = 0x19
    CONFIG = 0x1A
    GYRO_CONFIG = 0x1B
    ACCEL_CONFIG = 0x1C
    ACCEL_CONFIG_2 = 0x1D  # not in the MPU-6050
    FIFO_EN = 0x23
    INT_PIN_CFG = 0x37
    INT_ENABLE = 0x38
    INT_STATUS = 0x3A
    ACCEL_XOUT_H = 0x3B
    USER_CTRL = 0x6A
    PWR_MGMT_1 = 0x6B
    PWR_MGMT_2 = 0x6C  # bits 5:0 put the axes on standby: accelerometer xyz, gyroscope xyz
    FIFO_COUNTH = 0x72
    FIFO_R_W = 0x74
    WHO_AM_I = 0x75


class Power(IntEnum):
    """PWR_MGMT_1 (0x6B): the bits 7 and 6 and the clock sources CLKSEL (bits 2:0)."""

    INTERNAL_OSCILLATOR = 0x00
    PLL_GYRO_X = 0x01
    SLEEP = 0x40
    DEVICE_RESET = 0x80


class UserControl(IntEnum):
    """USER_CTRL (0x6A)."""

    FIFO_RESET = 0x04  # acts only while FIFO_EN is 0; clears itself
    FIFO_EN = 0x40


class FifoEnable(IntEnum):
    """FIFO_EN (0x23): what a sample writes into the FIFO, in the order of the output registers."""

    ACCEL = 0x08
    GYRO_Z = 0x10
    GYRO_Y = 0x20
    GYRO_X = 0x40
    TEMPERATURE = 0x80


class Interrupt(IntEnum):
    """INT_ENABLE (0x38) and INT_STATUS (0x3A), which clears on reading."""

    DATA_READY = 0x01
    FIFO_OVERFLOW = 0x10


class InterruptPin(IntEnum):
    """INT_PIN_CFG (0x37)."""

    CLEAR_ON_ANY_READ = 0x10
    LATCHED = 0x20  # held until cleared; else a pulse of 50 µs


SELF_TEST_ALL_AXES = 0xE0
"""Bits 7:5 of GYRO_CONFIG and ACCEL_CONFIG: an electrical push on x, y and z."""


@dataclass(frozen=True)
class RangeRow:
    """One full-scale range: the two bits at 4:3 of its register and the sensitivity, per g or per °/s."""

    code: int
    full_scale: int
    lsb_per_unit: float

    @property
    def register_value(self) -> int:
        """Return the bits in their place."""
        return self.code << 3


_ACCEL_RANGES_G = (  # AFS_SEL in ACCEL_CONFIG (0x1C)
    RangeRow(0, 2, 16384.0),
    RangeRow(1, 4, 8192.0),
    RangeRow(2, 8, 4096.0),
    RangeRow(3, 16, 2048.0),
)
_GYRO_RANGES_DEG_PER_S = (  # FS_SEL in GYRO_CONFIG (0x1B)
    RangeRow(0, 250, 131.0),
    RangeRow(1, 500, 65.5),
    RangeRow(2, 1000, 32.8),
    RangeRow(3, 2000, 16.4),
)
ACCEL_RANGES: dict[int, RangeRow] = {row.full_scale: row for row in _ACCEL_RANGES_G}
GYRO_RANGES: dict[int, RangeRow] = {row.full_scale: row for row in _GYRO_RANGES_DEG_PER_S}
