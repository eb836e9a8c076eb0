"""The MPU-6050 and those of its relatives whose registers are public: what differs between them, one row each.

Sources: RM-MPU-6000A-00 and PS-MPU-6000A-00 (MPU-6050), RM-MPU-6500A-00, RM-MPU-9250A-00 revision 1.6, the ICM-20689
data sheet DS-000143, and AN-MPU-6500A-02 for the self-test of all but the first.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.imu.registers import FIFO_BYTES, INTERNAL_RATE_HZ, INTERNAL_RATE_UNFILTERED_HZ, Power


@dataclass(frozen=True)
class FilterRow:
    """One row of the digital low-pass filters: DLPF_CFG in CONFIG (0x1A) bits 2:0, and A_DLPF_CFG in 0x1D where it is.

    `rate_hz` is the internal rate at which the gyroscope is sampled in this row.
    """

    code: int
    accel_bandwidth_hz: float
    accel_delay_s: float
    gyro_bandwidth_hz: float
    gyro_delay_s: float
    rate_hz: int = INTERNAL_RATE_HZ

    @property
    def delay_s(self) -> float:
        """Return what is taken off a sample's data-ready instant: the gyroscope's delay, for angles come from it."""
        return self.gyro_delay_s


def _rows(*rows: FilterRow) -> Mapping[int, FilterRow]:
    return {row.code: row for row in rows}


_MPU6050_ROWS = _rows(
    FilterRow(0, 260.0, 0.0000, 256.0, 0.00098, INTERNAL_RATE_UNFILTERED_HZ),
    FilterRow(1, 184.0, 0.0020, 188.0, 0.0019),
    FilterRow(2, 94.0, 0.0030, 98.0, 0.0028),
    FilterRow(3, 44.0, 0.0049, 42.0, 0.0048),
    FilterRow(4, 21.0, 0.0085, 20.0, 0.0083),
    FilterRow(5, 10.0, 0.0138, 10.0, 0.0134),
    FilterRow(6, 5.0, 0.0190, 5.0, 0.0186),
)
# The accelerometer's column is that of the MPU-9250's map, revision 1.6. The MPU-6500's own map, and earlier revisions
# of the other, print exactly twice the gyroscope's delays for the same silicon: a slip that was corrected there.
_MPU6500_ROWS = _rows(
    FilterRow(0, 218.1, 0.00188, 250.0, 0.00097, INTERNAL_RATE_UNFILTERED_HZ),
    FilterRow(1, 218.1, 0.00188, 184.0, 0.0029),
    FilterRow(2, 99.0, 0.00288, 92.0, 0.0039),
    FilterRow(3, 44.8, 0.00488, 41.0, 0.0059),
    FilterRow(4, 21.2, 0.00887, 20.0, 0.0099),
    FilterRow(5, 10.2, 0.01683, 10.0, 0.01785),
    FilterRow(6, 5.05, 0.03248, 5.0, 0.03348),
)
# The ICM-20689's data sheet prints no delays. Its bandwidths are the MPU-9250's but for one, so the delays are taken
# to be as well.
_ICM20689_ROWS = {**_MPU6500_ROWS, 1: FilterRow(1, 218.1, 0.00188, 176.0, 0.0029)}


@dataclass(frozen=True)
class ChipModel:
    """What WHO_AM_I (0x75) tells about a chip.

    Temperature is counts / `temperature_lsb_per_degC` + `temperature_at_zero_degC`. `has_accel_filter` is whether the
    accelerometer has a filter of its own in ACCEL_CONFIG_2 (0x1D), `accel_config_2` the bits that go there beside it
    (the ICM-20689's FIFO size). `shares_trim_registers` is the MPU-6050's packing of its self-test codes;
    `power_at_reset` is PWR_MGMT_1 after a reset.
    """

    who_am_i: int
    name: str
    filter_rows: Mapping[int, FilterRow]
    fifo_bytes: int
    temperature_lsb_per_degC: float
    temperature_at_zero_degC: float
    has_accel_filter: bool = True
    accel_config_2: int = 0
    shares_trim_registers: bool = False
    power_at_reset: int = Power.PLL_GYRO_X

    def temperature_degC(self, counts: int) -> float:
        """Return the temperature of the die."""
        return counts / self.temperature_lsb_per_degC + self.temperature_at_zero_degC


def _mpu6500(who_am_i: int, name: str) -> ChipModel:
    return ChipModel(who_am_i, name, _MPU6500_ROWS, 512, 333.87, 21.0)


MPU6050_WHO_AM_I = 0x68

_MODELS = (
    ChipModel(
        MPU6050_WHO_AM_I,
        "MPU-6050, MPU-6000 or MPU-9150",
        _MPU6050_ROWS,
        FIFO_BYTES,
        340.0,
        36.53,
        has_accel_filter=False,
        shares_trim_registers=True,
        power_at_reset=Power.SLEEP,
    ),
    _mpu6500(0x70, "MPU-6500"),
    _mpu6500(0x71, "MPU-9250"),
    _mpu6500(0x73, "MPU-9255"),
    _mpu6500(0x74, "MPU-6515"),
    ChipModel(0x98, "ICM-20689", _ICM20689_ROWS, 4096, 326.8, 25.0, accel_config_2=0xC0, power_at_reset=Power.SLEEP),
)
CHIPS: Mapping[int, ChipModel] = {model.who_am_i: model for model in _MODELS}
"""The supported chips by what WHO_AM_I answers."""

REFUSED: Mapping[int, str] = {
    0x00: "all zeros: no chip, or a data line held low",
    0x72: "a relative of the MPU-6500 sold as MPU-6050, of which no register map is public",
    0xFF: "all ones: no chip drives the data line",
}
"""What else has been seen to answer, and why it is not supported."""


def model_of(who_am_i: int) -> ChipModel:
    """Return the chip that answers so. Raises LookupError, saying which are supported, if it is none of them."""
    if who_am_i in CHIPS:
        return CHIPS[who_am_i]
    supported = ", ".join(f"0x{model.who_am_i:02x} {model.name}" for model in _MODELS)
    what = REFUSED.get(who_am_i, "no chip this driver knows")
    raise LookupError(f"WHO_AM_I reads 0x{who_am_i:02x} ({what}), supported are {supported}")
