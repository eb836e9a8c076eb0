"""Faults of the IMU: its bus, its data-ready line, its chip and its clock."""

import errno
import time
from collections.abc import Callable

from drivers.imu.registers import Power, Register, UserControl
from lab.faults.fault import BUS_FLAG_S, FRAME_FLAG_S, MOTION_FLAG_S, Expect, Fault, HardwareAction, Layer
from lab.faults.hardware import USUAL_LATENESS, FaultyHardware
from sim_rig.imu.mpu6050_chip import Mpu6050Chip

_ACCEL_RANGE_CODE, _GYRO_RANGE_CODE, _FILTER_CODE = 0x08, 0x08, 0x03
_RETRIES_USED_UP = 3


def _lasting(error: int, *, until_opened: bool = False) -> HardwareAction:
    return HardwareAction(
        lambda hardware: hardware.wires.stick(error, until_opened=until_opened),
        lambda hardware: hardware.wires.release(),
    )


def _chip(act: Callable[[Mpu6050Chip], None], back: Callable[[Mpu6050Chip], None] | None = None) -> HardwareAction:
    def clear(hardware: FaultyHardware) -> None:
        if back is not None:
            hardware.chip.do(back)

    return HardwareAction(lambda hardware: hardware.chip.do(act), clear)


def _again_and_again(act: Callable[[Mpu6050Chip], None], every_s: float) -> HardwareAction:
    """Do `act` to the chip every `every_s`, in the bus's own thread."""

    def inject(hardware: FaultyHardware) -> None:
        due_s = time.monotonic()

        def when_due(chip: Mpu6050Chip) -> None:
            nonlocal due_s
            if time.monotonic() >= due_s:
                due_s = time.monotonic() + every_s
                act(chip)

        hardware.chip.repeated["fault"] = when_due

    return HardwareAction(inject, lambda hardware: hardware.chip.repeated.clear())


def _clock(factor_after: Callable[[float], float]) -> HardwareAction:
    """Let the chip's clock run as many times faster as `factor_after` the seconds since the fault began says."""

    def inject(hardware: FaultyHardware) -> None:
        began_s = time.monotonic()
        hardware.chip.repeated["clock"] = lambda chip: chip.set_clock(factor_after(time.monotonic() - began_s))

    def clear(hardware: FaultyHardware) -> None:
        hardware.chip.repeated.pop("clock", None)
        hardware.chip.do(lambda chip: chip.set_clock(1.0))

    return HardwareAction(inject, clear)


def _answering(value: int) -> HardwareAction:
    def answer(hardware: FaultyHardware, with_value: int | None) -> None:
        hardware.chip.answer = with_value

    return HardwareAction(lambda hardware: answer(hardware, value), lambda hardware: answer(hardware, None))


def _write(register: Register, value: int) -> Callable[[Mpu6050Chip], None]:
    return lambda chip: chip.write(bytes([register, value]))


def _flush_fifo(chip: Mpu6050Chip) -> None:
    for value in (UserControl.FIFO_RESET, UserControl.FIFO_EN):
        chip.write(bytes([Register.USER_CTRL, value]))


def _lose_a_byte(chip: Mpu6050Chip) -> None:
    chip.write(bytes([Register.FIFO_R_W]))
    chip.read(1)


def _become(who_am_i: int) -> Callable[[Mpu6050Chip], None]:
    def act(chip: Mpu6050Chip) -> None:
        chip.who_am_i = who_am_i
        chip.brown_out()

    return act


def _bus(name: str, how: str, act: HardwareAction, hold_s: float = 1.5) -> Fault:
    return Fault(
        name=name,
        layer=Layer.IMU,
        how=how,
        act=act,
        expect=Expect.FLAGGED,
        limit_s=BUS_FLAG_S,
        hold_s=hold_s,
        touches="bus",
    )


def _chip_fault(
    name: str,
    how: str,
    act: HardwareAction,
    *,
    limit_s: float = BUS_FLAG_S,
    hold_s: float = 1.5,
    in_motion: bool = False,
) -> Fault:
    return Fault(
        name=name,
        layer=Layer.IMU,
        how=how,
        act=act,
        expect=Expect.FLAGGED,
        limit_s=limit_s,
        hold_s=hold_s,
        in_motion=in_motion,
        touches="chip",
    )


def _tolerated(name: str, how: str, act: HardwareAction, reason: str, touches: str) -> Fault:
    return Fault(name=name, layer=Layer.IMU, how=how, act=act, expect=Expect.TOLERATED, reason=reason, touches=touches)


BUS_FAULTS = (
    _tolerated(
        "imu-nak-once",
        "one I²C transfer is not acknowledged (EREMOTEIO)",
        HardwareAction(lambda hardware: hardware.wires.fail(errno.EREMOTEIO)),
        "a failed transfer is tried again",
        "bus",
    ),
    _tolerated(
        "imu-nak-burst",
        "one I²C transfer and all its retries are not acknowledged (ENXIO)",
        HardwareAction(lambda hardware: hardware.wires.fail(errno.ENXIO, _RETRIES_USED_UP)),
        "the driver reopens the bus; the FIFO has kept the samples",
        "bus",
    ),
    _tolerated(
        "imu-arbitration-lost",
        "bus arbitration is lost twice in a row (EAGAIN)",
        HardwareAction(lambda hardware: hardware.wires.fail(errno.EAGAIN, 2)),
        "a failed transfer is tried again",
        "bus",
    ),
    _tolerated(
        "imu-burst-broken",
        "a FIFO read fails after 14 bytes have left the chip (EIO)",
        HardwareAction(lambda hardware: hardware.wires.fail(errno.EIO, bytes_lost=14)),
        "one sample is lost and counted",
        "bus",
    ),
    _bus("imu-nak-eremoteio", "no I²C transfer is acknowledged any more (EREMOTEIO)", _lasting(errno.EREMOTEIO)),
    _bus("imu-nak-enxio", "no I²C transfer is acknowledged any more (ENXIO)", _lasting(errno.ENXIO)),
    _bus("imu-nak-eio", "every I²C transfer fails (EIO)", _lasting(errno.EIO)),
    _bus("imu-arbitration-never-won", "every bus arbitration is lost (EAGAIN)", _lasting(errno.EAGAIN)),
    _bus("imu-bus-stuck-short", "a bus line is held low for 0.2 s (ETIMEDOUT)", _lasting(errno.ETIMEDOUT), hold_s=0.2),
    _bus("imu-bus-stuck", "a bus line is held low for 3 s (ETIMEDOUT)", _lasting(errno.ETIMEDOUT), hold_s=3.0),
    _tolerated(
        "imu-bus-stuck-until-opened",
        "a bus line is held low until the driver reopens the bus (ETIMEDOUT)",
        _lasting(errno.ETIMEDOUT, until_opened=True),
        "reopening the bus is the driver's next step after retries; the FIFO keeps the samples meanwhile",
        "bus",
    ),
    _bus("imu-reads-ones", "the data line is disconnected: every byte reads 0xFF", _answering(0xFF)),
    _bus("imu-reads-zeros", "the data line is shorted: every byte reads 0x00", _answering(0x00)),
)

CHIP_FAULTS = (
    _chip_fault(
        "imu-brown-out",
        "the supply voltage drops: all registers return to their reset values, asleep, no bus error",
        _chip(lambda chip: chip.brown_out()),
    ),
    _chip_fault(
        "imu-brown-out-loop",
        "the supply voltage drops every 0.4 s for 3 s",
        _again_and_again(lambda chip: chip.brown_out(), 0.4),
        hold_s=3.0,
    ),
    _chip_fault(
        "imu-asleep",
        "a corrupted write puts the chip to sleep",
        _chip(_write(Register.PWR_MGMT_1, Power.SLEEP | Power.PLL_GYRO_X)),
    ),
    _chip_fault(
        "imu-frozen",
        "the sensor values never change while FIFO and data-ready go on",
        _chip(lambda chip: chip.freeze(), lambda chip: chip.freeze(False)),
        limit_s=FRAME_FLAG_S,
    ),
    _chip_fault(
        "imu-other-chip",
        "the chip restarts with an identity that no public register map describes (WHO_AM_I 0x72)",
        _chip(_become(0x72), _become(0x68)),
    ),
    _chip_fault(
        "imu-held-0.3s",
        "the chip stretches the bus clock for 0.3 s: the reader waits, the FIFO keeps 30 samples",
        _chip(lambda _chip: time.sleep(0.3)),
    ),
    _chip_fault(
        "imu-fifo-overflow",
        "the chip stretches the bus clock for 0.9 s: the FIFO overflows",
        _chip(lambda _chip: time.sleep(0.9)),
    ),
    _tolerated(
        "imu-fifo-flushed",
        "the FIFO is emptied once without the driver knowing",
        _chip(_flush_fifo),
        "one or two samples are lost and counted; so short a gap leaves the attitude valid",
        "chip",
    ),
    Fault(
        name="imu-burst-loss",
        layer=Layer.IMU,
        how="the FIFO is emptied every 25 ms for 2 s",
        act=_again_and_again(_flush_fifo, 0.025),
        expect=Expect.HONEST,
        hold_s=2.0,
        reason="some samples still arrive; the attitude filter decides whether they suffice",
        touches="chip",
    ),
    Fault(
        name="imu-fifo-misaligned",
        layer=Layer.IMU,
        how="one byte is lost from the FIFO, so that all samples after it are shifted",
        act=_chip(_lose_a_byte),
        expect=Expect.HONEST,
        reason="the driver detects it and empties the FIFO: some samples are lost",
        touches="chip",
    ),
    _chip_fault(
        "imu-accel-range-flipped",
        "a bit flips in ACCEL_CONFIG: accelerations read half of what they are",
        _chip(_write(Register.ACCEL_CONFIG, 0x10), _write(Register.ACCEL_CONFIG, _ACCEL_RANGE_CODE)),
        limit_s=MOTION_FLAG_S,
        hold_s=4.0,
        in_motion=True,
    ),
    _chip_fault(
        "imu-gyro-range-flipped",
        "a bit flips in GYRO_CONFIG: rates read half of what they are",
        _chip(_write(Register.GYRO_CONFIG, 0x10), _write(Register.GYRO_CONFIG, _GYRO_RANGE_CODE)),
        limit_s=MOTION_FLAG_S,
        hold_s=4.0,
        in_motion=True,
    ),
    Fault(
        name="imu-filter-flipped",
        layer=Layer.IMU,
        how="a bit flips in CONFIG: the low-pass filter delays by 19 ms instead of 5 ms",
        act=_chip(_write(Register.CONFIG, 0x06), _write(Register.CONFIG, _FILTER_CODE)),
        expect=Expect.HONEST,
        hold_s=4.0,
        in_motion=True,
        reason="found when the configuration is read back; until then the error is within the stated uncertainty",
        touches="chip",
    ),
)

CLOCK_FAULTS = (
    _tolerated(
        "imu-clock-fast-3",
        "the chip's clock runs 3 % fast",
        _clock(lambda _s: 1.03),
        "the driver estimates the sample period, within ±4 %",
        "clock",
    ),
    _tolerated(
        "imu-clock-slow-3",
        "the chip's clock runs 3 % slow",
        _clock(lambda _s: 0.97),
        "the driver estimates the sample period, within ±4 %",
        "clock",
    ),
    _tolerated(
        "imu-clock-drift",
        "the chip's clock drifts by 1 % in 1.5 s",
        _clock(lambda s: 1.0 + s / 150.0),
        "the estimated sample period follows",
        "clock",
    ),
    Fault(
        name="imu-clock-fast-8",
        layer=Layer.IMU,
        how="the chip's clock runs 8 % fast, beyond its specification",
        act=_clock(lambda _s: 1.08),
        expect=Expect.HONEST,
        hold_s=5.0,
        in_motion=True,
        reason="rates and times are wrong by 8 %; the ground is right or marked invalid",
        touches="clock",
    ),
)


def _late_edges(share: float, latest_s: float) -> HardwareAction:
    def late(hardware: FaultyHardware, share: float, latest_s: float) -> None:
        hardware.data_ready.late_share, hardware.data_ready.latest_s = share, latest_s

    return HardwareAction(
        lambda hardware: late(hardware, share, latest_s), lambda hardware: late(hardware, *USUAL_LATENESS)
    )


LINE_FAULTS = (
    _tolerated(
        "imu-line-cut",
        "the data-ready wire breaks",
        HardwareAction(lambda hardware: hardware.data_ready.cut(), lambda hardware: hardware.data_ready.cut(False)),
        "the driver polls the chip, and the FIFO keeps the samples meanwhile",
        "line",
    ),
    _tolerated(
        "imu-line-gone",
        "the GPIO controller of the data-ready line disappears (ENODEV)",
        HardwareAction(
            lambda hardware: hardware.data_ready.take_away(), lambda hardware: hardware.data_ready.take_away(False)
        ),
        "the driver polls the chip, and the FIFO keeps the samples meanwhile",
        "line",
    ),
    _tolerated(
        "imu-edges-lost",
        "twenty data-ready edges in a row are lost",
        HardwareAction(lambda hardware: hardware.data_ready.lose(20)),
        "the FIFO keeps the samples; the driver waits for the line only for a limited time",
        "line",
    ),
    _tolerated(
        "imu-edges-late",
        "half of the data-ready interrupts are handled up to 8 ms late",
        _late_edges(0.5, 0.008),
        "the sample clock relies on the earliest interrupts",
        "line",
    ),
)

IMU_FAULTS = BUS_FAULTS + LINE_FAULTS + CHIP_FAULTS + CLOCK_FAULTS
