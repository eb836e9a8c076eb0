"""The catalogue's IMU: its bus, its chip and its clock."""

import errno
import time
from collections.abc import Callable

from drivers.imu.registers import Power, Register, UserControl
from lab.faults.bench import USUAL_LATENESS, Bench
from lab.faults.fault import BUS_FLAG_S, FRAME_FLAG_S, MOTION_FLAG_S, Expect, Fault, Layer, Tamper
from sim_rig.imu.mpu6050_chip import Mpu6050Chip

_ACCEL_RANGE_CODE, _GYRO_RANGE_CODE, _FILTER_CODE = 0x08, 0x08, 0x03
_RETRIES_USED_UP = 3


def _lasting(error: int, *, until_opened: bool = False) -> Tamper:
    return Tamper(
        lambda bench: bench.wires.stick(error, until_opened=until_opened), lambda bench: bench.wires.release()
    )


def _chip(act: Callable[[Mpu6050Chip], None], back: Callable[[Mpu6050Chip], None] | None = None) -> Tamper:
    def clear(bench: Bench) -> None:
        if back is not None:
            bench.chip.do(back)

    return Tamper(lambda bench: bench.chip.do(act), clear)


def _again_and_again(act: Callable[[Mpu6050Chip], None], every_s: float) -> Tamper:
    """Do `act` to the chip every `every_s`, in the bus's own thread."""

    def inject(bench: Bench) -> None:
        due_s = time.monotonic()

        def habit(chip: Mpu6050Chip) -> None:
            nonlocal due_s
            if time.monotonic() >= due_s:
                due_s = time.monotonic() + every_s
                act(chip)

        bench.chip.habits["fault"] = habit

    return Tamper(inject, lambda bench: bench.chip.habits.clear())


def _clock(factor_after: Callable[[float], float]) -> Tamper:
    """Let the chip's clock run as many times faster as `factor_after` the seconds since the fault began says."""

    def inject(bench: Bench) -> None:
        began_s = time.monotonic()
        bench.chip.habits["clock"] = lambda chip: chip.set_clock(factor_after(time.monotonic() - began_s))

    def clear(bench: Bench) -> None:
        bench.chip.habits.pop("clock", None)
        bench.chip.do(lambda chip: chip.set_clock(1.0))

    return Tamper(inject, clear)


def _answering(value: int) -> Tamper:
    def answer(bench: Bench, with_value: int | None) -> None:
        bench.chip.answer = with_value

    return Tamper(lambda bench: answer(bench, value), lambda bench: answer(bench, None))


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


def _bus(name: str, how: str, act: Tamper, hold_s: float = 1.5) -> Fault:
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
    name: str, how: str, act: Tamper, *, limit_s: float = BUS_FLAG_S, hold_s: float = 1.5, in_motion: bool = False
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


def _tolerated(name: str, how: str, act: Tamper, reason: str, touches: str) -> Fault:
    return Fault(name=name, layer=Layer.IMU, how=how, act=act, expect=Expect.TOLERATED, reason=reason, touches=touches)


BUS_FAULTS = (
    _tolerated(
        "imu-nak-once",
        "one transfer is not acknowledged (EREMOTEIO)",
        Tamper(lambda bench: bench.wires.fail(errno.EREMOTEIO)),
        "a transfer is tried again",
        "bus",
    ),
    _tolerated(
        "imu-nak-burst",
        "all tries of one transfer are not acknowledged (ENXIO)",
        Tamper(lambda bench: bench.wires.fail(errno.ENXIO, _RETRIES_USED_UP)),
        "the bus is opened anew, the FIFO has kept the samples",
        "bus",
    ),
    _tolerated(
        "imu-arbitration-lost",
        "arbitration is lost twice in a row (EAGAIN)",
        Tamper(lambda bench: bench.wires.fail(errno.EAGAIN, 2)),
        "a transfer is tried again",
        "bus",
    ),
    _tolerated(
        "imu-burst-broken",
        "a FIFO burst breaks off after 14 bytes have left the chip (EIO)",
        Tamper(lambda bench: bench.wires.fail(errno.EIO, bytes_lost=14)),
        "one sample is lost and counted",
        "bus",
    ),
    _bus("imu-nak-eremoteio", "no transfer is acknowledged any more (EREMOTEIO)", _lasting(errno.EREMOTEIO)),
    _bus("imu-nak-enxio", "no transfer is acknowledged any more (ENXIO)", _lasting(errno.ENXIO)),
    _bus("imu-nak-eio", "every transfer fails (EIO)", _lasting(errno.EIO)),
    _bus("imu-arbitration-never-won", "every arbitration is lost (EAGAIN)", _lasting(errno.EAGAIN)),
    _bus("imu-bus-stuck-short", "a line is held low for 0.2 s (ETIMEDOUT)", _lasting(errno.ETIMEDOUT), hold_s=0.2),
    _bus("imu-bus-stuck", "a line is held low for 3 s (ETIMEDOUT)", _lasting(errno.ETIMEDOUT), hold_s=3.0),
    _tolerated(
        "imu-bus-stuck-until-opened",
        "a line is held low until the bus is opened anew (ETIMEDOUT)",
        _lasting(errno.ETIMEDOUT, until_opened=True),
        "opening the bus anew is the next rung of the ladder; the FIFO keeps the samples meanwhile",
        "bus",
    ),
    _bus("imu-reads-ones", "the data line is lost: every byte reads 0xFF", _answering(0xFF)),
    _bus("imu-reads-zeros", "the data line is shorted: every byte reads 0x00", _answering(0x00)),
)

CHIP_FAULTS = (
    _chip_fault(
        "imu-brown-out",
        "power dips: all registers at their reset values, asleep, no error on the bus",
        _chip(lambda chip: chip.brown_out()),
    ),
    _chip_fault(
        "imu-brown-out-loop",
        "power dips every 0.4 s for 3 s",
        _again_and_again(lambda chip: chip.brown_out(), 0.4),
        hold_s=3.0,
    ),
    _chip_fault(
        "imu-asleep",
        "a disturbed write puts the chip to sleep",
        _chip(_write(Register.PWR_MGMT_1, Power.SLEEP | Power.PLL_GYRO_X)),
    ),
    _chip_fault(
        "imu-frozen",
        "the sensor values stand still while FIFO and data-ready go on",
        _chip(lambda chip: chip.freeze(), lambda chip: chip.freeze(False)),
        limit_s=FRAME_FLAG_S,
    ),
    _chip_fault(
        "imu-other-chip",
        "the chip restarts as one that no public register map describes (WHO_AM_I 0x72)",
        _chip(_become(0x72), _become(0x68)),
    ),
    _chip_fault(
        "imu-held-0.3s",
        "the chip stretches the clock for 0.3 s: the reader hangs, the FIFO keeps 30 samples",
        _chip(lambda _chip: time.sleep(0.3)),
    ),
    _chip_fault(
        "imu-fifo-overflow",
        "the chip stretches the clock for 0.9 s: the FIFO overflows",
        _chip(lambda _chip: time.sleep(0.9)),
    ),
    _tolerated(
        "imu-fifo-flushed",
        "the FIFO is emptied once behind the driver's back",
        _chip(_flush_fifo),
        "a sample or two are lost and counted; the gap is shorter than what makes the attitude doubtful",
        "chip",
    ),
    Fault(
        name="imu-burst-loss",
        layer=Layer.IMU,
        how="the FIFO is emptied every 25 ms for 2 s",
        act=_again_and_again(_flush_fifo, 0.025),
        expect=Expect.HONEST,
        hold_s=2.0,
        reason="part of the samples still comes; whether they suffice is for the attitude to say",
        touches="chip",
    ),
    Fault(
        name="imu-fifo-misaligned",
        layer=Layer.IMU,
        how="one byte leaves the FIFO unseen, so that all frames after it are shifted",
        act=_chip(_lose_a_byte),
        expect=Expect.HONEST,
        reason="the driver throws the FIFO away: some samples less",
        touches="chip",
    ),
    _chip_fault(
        "imu-accel-range-flipped",
        "ACCEL_CONFIG loses a bit: accelerations read half of what they are",
        _chip(_write(Register.ACCEL_CONFIG, 0x10), _write(Register.ACCEL_CONFIG, _ACCEL_RANGE_CODE)),
        limit_s=MOTION_FLAG_S,
        hold_s=4.0,
        in_motion=True,
    ),
    _chip_fault(
        "imu-gyro-range-flipped",
        "GYRO_CONFIG loses a bit: rates read half of what they are",
        _chip(_write(Register.GYRO_CONFIG, 0x10), _write(Register.GYRO_CONFIG, _GYRO_RANGE_CODE)),
        limit_s=MOTION_FLAG_S,
        hold_s=4.0,
        in_motion=True,
    ),
    Fault(
        name="imu-filter-flipped",
        layer=Layer.IMU,
        how="CONFIG changes: the low-pass filter delays by 19 ms in place of 5 ms",
        act=_chip(_write(Register.CONFIG, 0x06), _write(Register.CONFIG, _FILTER_CODE)),
        expect=Expect.HONEST,
        hold_s=4.0,
        in_motion=True,
        reason="found by the read-back of the configuration; until then the error is within what is stated",
        touches="chip",
    ),
)

CLOCK_FAULTS = (
    _tolerated(
        "imu-clock-fast-3",
        "the chip's clock runs 3 % fast",
        _clock(lambda _s: 1.03),
        "the period is estimated, within ±4 %",
        "clock",
    ),
    _tolerated(
        "imu-clock-slow-3",
        "the chip's clock runs 3 % slow",
        _clock(lambda _s: 0.97),
        "the period is estimated, within ±4 %",
        "clock",
    ),
    _tolerated(
        "imu-clock-drift",
        "the chip's clock drifts by 1 % in 1.5 s",
        _clock(lambda s: 1.0 + s / 150.0),
        "the estimate follows",
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
        reason="rates and times are off by 8 %; the ground is right or refused",
        touches="clock",
    ),
)


def _late_edges(share: float, latest_s: float) -> Tamper:
    def late(bench: Bench, share: float, latest_s: float) -> None:
        bench.data_ready.late_share, bench.data_ready.latest_s = share, latest_s

    return Tamper(lambda bench: late(bench, share, latest_s), lambda bench: late(bench, *USUAL_LATENESS))


LINE_FAULTS = (
    _tolerated(
        "imu-line-cut",
        "the data-ready wire breaks",
        Tamper(lambda bench: bench.data_ready.cut(), lambda bench: bench.data_ready.cut(False)),
        "the chip is polled, and the FIFO keeps what comes meanwhile",
        "line",
    ),
    _tolerated(
        "imu-line-gone",
        "the GPIO chip of the data-ready line vanishes (ENODEV)",
        Tamper(lambda bench: bench.data_ready.take_away(), lambda bench: bench.data_ready.take_away(False)),
        "the chip is polled, and the FIFO keeps what comes meanwhile",
        "line",
    ),
    _tolerated(
        "imu-edges-lost",
        "twenty data-ready edges in a row are lost",
        Tamper(lambda bench: bench.data_ready.lose(20)),
        "the FIFO keeps the samples; the line is not waited for without end",
        "line",
    ),
    _tolerated(
        "imu-edges-late",
        "half of the data-ready interrupts are served up to 8 ms late",
        _late_edges(0.5, 0.008),
        "the sample clock believes the early ones",
        "line",
    ),
)

IMU_FAULTS = BUS_FAULTS + LINE_FAULTS + CHIP_FAULTS + CLOCK_FAULTS
