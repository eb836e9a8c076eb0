"""MPU-6050 over I2C: identify, configure, read in bursts through its FIFO, back-date, and mend what breaks.

The chip's facts stand in `drivers.mpu6050_registers`, the configuration is computed once from the settings, and what
changes while it runs is in `_Stream`: three things kept apart. Source of every procedure: InvenSense MPU-6000/
MPU-6050 Register Map and Descriptions, and Product Specification (start-up times, FIFO).
"""

import errno
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NoReturn

from drivers.mpu6050_registers import (
    CHIP_NAMES,
    FIFO_BYTES,
    FILTER_SETTLING_S,
    GYRO_START_S,
    MPU6050_WHO_AM_I,
    RESET_S,
    TEMPERATURE_AT_ZERO_DEGC,
    TEMPERATURE_LSB_PER_DEGC,
    Interrupt,
    Power,
    Register,
    UserControl,
)
from drivers.mpu6050_settings import Mpu6050Settings, configure
from drivers.protocols import DeviceError, RegisterBus
from drivers.register_access import ATTEMPTS, RegisterAccess
from drivers.sample_clock import SampleClock
from messages import ImuSample

_FRAME = struct.Struct(">7h")  # accelerometer xyz, temperature, gyroscope xyz, as the output registers stand
_MIN_ROOM_FRAMES = 3  # with no more room than this the FIFO may overflow while it is being read
_CHECK_EVERY_S = 1.0
_STALL_PERIODS = 8
_FROZEN_FRAMES = 20  # noise alone keeps a living chip from repeating itself so often
_CLIPPED = (-32768, 32767)


@dataclass
class Mpu6050Counters:
    """Since the driver was made: samples lost, transfers failed, FIFOs flushed for overflow, chips reset to mend."""

    lost: int = 0
    bus_errors: int = 0
    fifo_overflows: int = 0
    resets: int = 0


@dataclass
class _Stream:
    """What changes while the chip runs. Samples are numbered from 1 since the first start."""

    taken: int = 0  # the newest sample taken from the chip, discarded ones included
    delivered: int = 0  # the newest sample returned
    heard_ns: int = 0  # when there was last a sample, or a start
    heard_since_start: bool = False
    checked_ns: int = 0
    frame: bytes = b""
    repeats: int = 0


class Mpu6050:
    """The IMU as `drivers.protocols.ImuSource`; call `open` first, then `read` about twice per sample period.

    Where the adapter has true I2C transfers, samples come from the chip's FIFO and polling may be late by half a
    second without loss; where it knows SMBus only, they come from the output registers, and a poll later than one
    period loses samples, which are counted.

    `t_sample_ns` is the estimated data-ready instant minus the mean of the two sensors' filter delays (each is
    within 0.2 ms of it, at the default row 0.05 ms). `seq` numbers the chip's samples, lost ones included.

    Faults climb a ladder: a register transfer is tried three times; then the bus is opened anew; then the chip is
    reset and configured; then DeviceError is raised, and the next `read` starts over. Once a second, and when
    samples stop, the configuration is read back, because a brown-out silently returns the chip to sleep.
    """

    def __init__(
        self,
        open_bus: Callable[[], RegisterBus],
        *,
        address: int = 0x68,
        settings: Mpu6050Settings,
        clock: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._counters = Mpu6050Counters()
        self._address = address
        self._configuration = configure(settings)
        self._clock = clock
        self._sleep = sleep
        self._access = RegisterAccess(open_bus, address, self._counters, sleep)
        self._sample_clock = SampleClock(self._configuration.period_s)
        self._stream = _Stream()

    @property
    def counters(self) -> Mpu6050Counters:
        """Return the counters since the driver was made."""
        return self._counters

    @property
    def period_s(self) -> float:
        """Return the chip's true sample period as estimated so far."""
        return self._sample_clock.period_s

    def open(self) -> None:
        """Identify, reset and configure the chip and start its samples; takes about a quarter of a second.

        Raises DeviceError if the bus or the chip does not answer, or if the chip is another one.
        """
        try:
            self._connect()
            self._start()
        except OSError as error:
            self._give_up(error)

    def read(self) -> Sequence[ImuSample]:
        """Return all samples taken since the last call, oldest first; empty if there are none or after mending.

        Raises DeviceError when the ladder is at its end, or when another chip answers; a later call starts over.
        """
        if self._access.is_open:
            try:
                return self._poll()
            except OSError:
                if self._reopen():
                    return []
        self._restart()
        return []

    def close(self) -> None:
        """Release the bus."""
        self._access.close()

    # Starting and mending

    def _connect(self) -> None:
        self._access.reopen(Register.WHO_AM_I)
        who_am_i = self._access.read_byte(Register.WHO_AM_I)
        if who_am_i != MPU6050_WHO_AM_I:
            self._access.close()
            name = CHIP_NAMES.get(who_am_i, "no chip this driver knows")
            raise DeviceError(
                f"IMU at I2C address 0x{self._address:02x}: WHO_AM_I reads 0x{who_am_i:02x} ({name}), "
                f"expected 0x{MPU6050_WHO_AM_I:02x} ({CHIP_NAMES[MPU6050_WHO_AM_I]})"
            )

    def _start(self) -> None:
        self._access.write_byte(Register.PWR_MGMT_1, Power.DEVICE_RESET)
        self._sleep(RESET_S)
        self._access.write_byte(Register.PWR_MGMT_1, Power.INTERNAL_OSCILLATOR)
        self._sleep(GYRO_START_S)  # the PLL may be chosen only once the gyroscope runs
        for register, value in self._configuration.registers:
            self._access.write_byte(register, value)
        self._sleep(FILTER_SETTLING_S)
        if wrong := self._wrong_register():
            raise OSError(errno.EIO, wrong)
        t_before_ns = self._discard_waiting()
        self._sample_clock.restart(self._stream.taken, t_before_ns)
        self._stream.heard_ns = self._stream.checked_ns = t_before_ns
        self._stream.heard_since_start = False

    def _wrong_register(self) -> str:
        """Return which register does not hold what was written to it; empty if all do."""
        for register, expected in self._configuration.registers:
            value = self._access.read_byte(register)
            if value != expected:
                return f"{register.name} reads 0x{value:02x}, was set to 0x{expected:02x}"
        return ""

    def _reopen(self) -> bool:
        """Open the bus anew; return whether the chip is still there and configured."""
        try:
            self._connect()
            return not self._wrong_register()
        except OSError:
            return False

    def _restart(self) -> None:
        """Open the bus anew, reset and configure the chip."""
        try:
            self._connect()
            self._start()
        except OSError as error:
            self._give_up(error)
        self._counters.resets += 1

    def _give_up(self, error: OSError) -> NoReturn:
        self._access.close()
        raise DeviceError(f"IMU at I2C address 0x{self._address:02x}: {error}") from error

    # Reading

    def _poll(self) -> list[ImuSample]:
        now_ns = self._clock()
        if now_ns - self._stream.checked_ns > _CHECK_EVERY_S * 1e9:
            self._stream.checked_ns = now_ns
            if self._wrong_register():
                self._restart()
                return []
        return self._read_fifo() if self._access.has_combined_transfers else self._read_outputs()

    def _read_outputs(self) -> list[ImuSample]:
        """Take the sample in the output registers; after a late poll, look again if it is in doubt which one it is."""
        data, t_before_ns, t_after_ns = self._new_output()
        if not data:
            return self._nothing_new(t_before_ns)
        doubt_s = self._sample_clock.doubt_s(self._stream.taken + 1, t_before_ns)
        if doubt_s > 0.0:
            self._sleep(doubt_s)
            further, t_before_ns, t_after_ns = self._new_output()
            data += further
        return self._samples(data, t_before_ns, t_after_ns)

    def _new_output(self) -> tuple[bytes, int, int]:
        """Return the output registers if they are new, else nothing, and the times before and after.

        INT_STATUS stands right before them and one burst is from one instant, so the two belong together.
        """
        t_before_ns = self._clock()
        block = self._access.read(Register.INT_STATUS, 1 + _FRAME.size)
        t_after_ns = self._clock()
        return (block[1:] if block[0] & Interrupt.DATA_READY else b""), t_before_ns, t_after_ns

    def _read_fifo(self) -> list[ImuSample]:
        """Drain the FIFO. A broken burst is tried again if the FIFO still holds whole frames."""
        for _ in range(ATTEMPTS):
            count, t_before_ns, t_after_ns = self._fifo_count()
            room_frames = (FIFO_BYTES - count) // _FRAME.size
            if count % _FRAME.size or room_frames <= _MIN_ROOM_FRAMES:
                return self._flush()
            if count == 0:
                return self._nothing_new(t_before_ns)
            try:
                data = self._access.burst(Register.FIFO_R_W, count)
            except OSError as error:
                fault = error
                continue
            if self._clock() - t_before_ns > room_frames * self.period_s * 1e9:
                return self._flush()  # held up for so long that it may have overflowed meanwhile
            return self._samples(data, t_before_ns, t_after_ns)
        raise fault

    def _fifo_count(self) -> tuple[int, int, int]:
        """Return the bytes in the FIFO and the times before and after; once more if a frame seems half written."""
        for _ in range(2):
            t_before_ns = self._clock()
            count = self._access.read_word(Register.FIFO_COUNTH)
            t_after_ns = self._clock()
            if count % _FRAME.size == 0:
                break
        return count, t_before_ns, t_after_ns

    def _flush(self) -> list[ImuSample]:
        """Discard what the FIFO holds, halfway between two samples so that no doubt remains which were lost."""
        self._counters.fifo_overflows += 1
        self._sleep(self._sample_clock.until_mid_period_s(self._clock()))
        self._stream.heard_ns = self._discard_waiting()
        self._sample_clock.skip_to(self._stream.taken)
        return []

    def _discard_waiting(self) -> int:
        """Empty the FIFO, or forget a waiting data-ready, and count the samples passed by then; return when it was."""
        if self._access.has_combined_transfers:
            self._access.write_byte(Register.USER_CTRL, UserControl.FIFO_RESET)
            t_before_ns = self._clock()
            self._access.write_byte(Register.USER_CTRL, UserControl.FIFO_EN)
        else:
            t_before_ns = self._clock()
            self._access.read_byte(Register.INT_STATUS)
        self._stream.taken = self._sample_clock.completed_at((t_before_ns + self._clock()) // 2)
        return t_before_ns

    def _nothing_new(self, t_ns: int) -> list[ImuSample]:
        """Note that no sample had come at `t_ns`; restart the chip if none has come for long."""
        self._sample_clock.pending_at(self._stream.taken + 1, t_ns)
        if t_ns - self._stream.heard_ns > _STALL_PERIODS * self._configuration.period_s * 1e9:
            self._mend("delivers no samples")
        return []

    def _mend(self, symptom: str) -> None:
        """Restart a chip that answers without working; raise DeviceError if it has not worked since the last start."""
        hopeless = not self._stream.heard_since_start
        self._restart()
        if hopeless:
            raise DeviceError(f"IMU at I2C address 0x{self._address:02x}: answers but {symptom}")

    def _samples(self, data: bytes, t_before_ns: int, t_after_ns: int) -> list[ImuSample]:
        """Turn the frames taken at an instant between the two times into samples."""
        stream = self._stream
        frames = [data[i : i + _FRAME.size] for i in range(0, len(data), _FRAME.size)]
        if self._is_frozen(frames):
            self._mend("its samples never change")
            return []
        newest = stream.taken + len(frames)
        newest += self._sample_clock.missed(newest, t_before_ns)
        self._sample_clock.pending_at(newest + 1, t_before_ns)
        self._sample_clock.completed_by(newest, t_after_ns)
        stream.taken = newest
        stream.heard_ns = t_after_ns
        stream.heard_since_start = True
        t_arrival_ns = self._clock()
        return [
            self._sample(frame, newest - back, t_arrival_ns)
            for back, frame in zip(range(len(frames))[::-1], frames, strict=True)
        ]

    def _is_frozen(self, frames: Sequence[bytes]) -> bool:
        stream = self._stream
        for frame in frames:
            stream.repeats = stream.repeats + 1 if frame == stream.frame else 0
            stream.frame = frame
        return stream.repeats >= _FROZEN_FRAMES

    def _sample(self, frame: bytes, index: int, t_arrival_ns: int) -> ImuSample:
        raw = _FRAME.unpack(frame)
        sf, temperature, w = raw[0:3], raw[3], raw[4:7]
        lost = index - self._stream.delivered - 1
        self._stream.delivered = index
        self._counters.lost += lost
        mps2, radps = self._configuration.mps2_per_lsb, self._configuration.radps_per_lsb
        return ImuSample(
            seq=index,
            t_sample_ns=self._sample_clock.stamp(index) - round(self._configuration.filter_row.delay_s * 1e9),
            t_arrival_ns=t_arrival_ns,
            sf_B_mps2=(sf[0] * mps2, sf[1] * mps2, sf[2] * mps2),
            w_WB_B_radps=(w[0] * radps, w[1] * radps, w[2] * radps),
            temperature_degC=temperature / TEMPERATURE_LSB_PER_DEGC + TEMPERATURE_AT_ZERO_DEGC,
            clipped=any(value in _CLIPPED for value in sf + w),
            lost_before=lost,
        )
