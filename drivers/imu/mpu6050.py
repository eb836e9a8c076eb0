"""MPU-6050 over I2C: identify, configure, read in bursts through its FIFO, back-date, and mend what breaks.

What chips there are stands in `drivers.imu.chips`, the configuration is computed once from settings and chip, and
what changes with each sample is in `drivers.imu.stream`: three things kept apart. Source of every procedure:
InvenSense MPU-6000/MPU-6050 Register Map and Descriptions, and Product Specification (start-up times, FIFO).
"""

import errno
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NoReturn

from drivers.imu.chips import ChipModel, model_of
from drivers.imu.frames import FRAME, fifo_count, new_output, split
from drivers.imu.register_access import ATTEMPTS, RegisterAccess, RegisterBus
from drivers.imu.registers import (
    FILTER_SETTLING_S,
    GYRO_START_S,
    RESET_S,
    Power,
    Register,
    UserControl,
)
from drivers.imu.sample_wait import SampleWait
from drivers.imu.self_test import SelfTest, run_self_test
from drivers.imu.settings import Mpu6050Settings, configure
from drivers.imu.stream import SampleStream
from drivers.protocols import DataReadyLine, DeviceError
from messages import ImuSample

_MIN_ROOM_FRAMES = 3  # with no more room than this the FIFO may overflow while it is being read
_CHECK_EVERY_NS = 1_000_000_000
_FASTEST_BYTE_S = 9 / 400_000  # fast mode is the most these chips know
_CHECK_SILENCE_PERIODS = 3
_STALL_PERIODS = 8


@dataclass
class Mpu6050Counters:
    """Since the driver was made; `drivers.protocols.ImuCounters` says what each counts."""

    lost: int = 0
    bus_errors: int = 0
    fifo_overflows: int = 0
    frames_refused: int = 0
    resets: int = 0
    edges_missed: int = 0


class Mpu6050:
    """An MPU-6050, or a relative of `drivers.imu.chips`, as `drivers.protocols.ImuSource`; call `open` first.

    Where the adapter has true I2C transfers, samples come from the chip's FIFO and reading may be late by half a
    second (MPU-6500 and its like: a quarter) without loss; where it knows SMBus only, they come from the output
    registers, and a look later than one period loses samples, which are counted.

    `open_data_ready` opens the line on which the chip's INT pin hangs; `read` then wakes with each sample, and the
    kernel's stamps make the sample times exact to some hundredths of a millisecond. Without it, and while the line is
    silent or gone though samples come (`edges_missed`), the chip is polled about twice per sample.

    `t_sample_ns` is the estimated data-ready instant minus the gyroscope's filter delay. The accelerometer's filter
    differs: by 0.1 ms in the MPU-6050's default row, by up to 0.4 ms in its others, and by 1.0 ms in all relatives,
    whose specific force is therefore 1.0 ms younger than `t_sample_ns` says. `seq` numbers the chip's samples, lost
    ones included.

    Faults are met in steps: a register transfer is tried three times; then the bus is opened anew; then, if the chip
    lost its configuration or still fails, it is reset and configured; then DeviceError is raised, and the next `read`
    starts over. Once a second, and when samples stop for three periods, the configuration is read back, because a
    brown-out silently returns the chip to sleep. After a recovery no sample is delivered before one has come that
    differs from its predecessor.
    """

    def __init__(
        self,
        open_bus: Callable[[], RegisterBus],
        *,
        address: int = 0x68,
        settings: Mpu6050Settings,
        open_data_ready: Callable[[], DataReadyLine] | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._counters = Mpu6050Counters()
        self._address = address
        self._settings = settings
        self._chip: ChipModel | None = None
        self._clock = clock
        self._sleep = sleep
        self._access = RegisterAccess(open_bus, address, self._counters, sleep)
        configuration = configure(settings)
        self._stream = SampleStream(configuration, self._counters, clock, has_edges=open_data_ready is not None)
        self._wait = SampleWait(open_data_ready, configuration.period_s, clock, sleep)
        self._checked_ns = 0  # when the configuration was last read back
        self._checked_silence_ns = 0  # the same, because samples stopped
        self._reopened_after_ns: int | None = None  # the last sample before the bus was opened anew

    @property
    def counters(self) -> Mpu6050Counters:
        """Return the counters since the driver was made."""
        return self._counters

    @property
    def chip(self) -> ChipModel | None:
        """Return which chip it is; None before the first `open`."""
        return self._chip

    @property
    def period_s(self) -> float:
        """Return the chip's true sample period as estimated so far."""
        return self._stream.period_s

    @property
    def filter_delay_s(self) -> float:
        """Return what `t_sample_ns` is earlier than the data-ready instant."""
        return self._stream.configuration.filter_row.delay_s

    def open(self) -> None:
        """Identify, reset and configure the chip and start its samples; takes about a quarter of a second.

        Raises DeviceError if the bus, the chip or the data-ready line cannot be had, or if the chip is not supported.
        """
        try:
            self._connect()
            self._wait.open()
            self._start()
        except OSError as error:
            self._fail(error)

    def read(self, timeout_s: float) -> Sequence[ImuSample]:
        """Return all samples taken since the last call, oldest first; empty if none came within `timeout_s`.

        With 0 the chip is asked once, without waiting. Raises DeviceError when the last step has failed, or when
        another chip answers; a later call starts over. Recovery may take a quarter of a second longer.
        """
        end_ns = self._clock() + round(timeout_s * 1e9)
        while True:
            if self._access.is_open:
                self._stream.add_edges(self._wait.until(end_ns, edges_expected=self._stream.edges_are_seen))
            samples = self._read_now()
            if samples or self._clock() >= end_ns:
                return samples

    def self_test(self) -> SelfTest:
        """Push each axis electrically and compare with the factory's trim; takes about two seconds.

        The chip is configured and streaming again afterwards, the samples meanwhile count as lost. Raises DeviceError
        if the unit was not at rest or the chip cannot be had.
        """
        if self._chip is None or not self._access.is_open:
            self.open()
        try:
            try:
                return run_self_test(self._access, self._chip_found(), self._sleep)
            finally:
                self._start()
        except OSError as error:
            self._fail(error)

    def close(self) -> None:
        """Release the bus and the line."""
        self._access.close()
        self._wait.close()

    # Starting and mending

    def _connect(self) -> None:
        """Open the bus; make sure that the chip is the one that was found first, or find it."""
        self._access.reopen(Register.WHO_AM_I)
        self._identify()

    def _identify(self) -> None:
        try:
            found = model_of(self._access.read_byte(Register.WHO_AM_I))
        except LookupError as error:
            self._fail_because(str(error))
        if self._chip is None:
            self._chip = found
            self._stream.configuration = configure(self._settings, found)
        elif found is not self._chip:
            self._fail_because(f"it is now 0x{found.who_am_i:02x} {found.name}, was 0x{self._chip.who_am_i:02x}")

    def _chip_found(self) -> ChipModel:
        if self._chip is None:
            raise OSError(errno.ENODEV, "no chip found yet")
        return self._chip

    def _start(self) -> None:
        self._identify()
        self._access.write_byte(Register.PWR_MGMT_1, Power.DEVICE_RESET)
        self._sleep(RESET_S)
        self._access.write_byte(Register.PWR_MGMT_1, Power.INTERNAL_OSCILLATOR)
        self._sleep(GYRO_START_S)  # the PLL may be chosen only once the gyroscope runs
        for register, value in self._stream.configuration.registers:
            self._access.write_byte(register, value)
        self._sleep(FILTER_SETTLING_S)
        t_before_ns = self._discard_waiting()
        if wrong := self._wrong_register():
            raise OSError(errno.EIO, wrong)
        self._stream.restarted_at(t_before_ns)
        self._checked_ns = t_before_ns

    def _wrong_register(self) -> str:
        """Return which register does not hold what was written to it; empty if all do."""
        expected: dict[int, int] = dict(self._stream.configuration.registers)
        expected[Register.USER_CTRL] = UserControl.FIFO_EN if self._access.has_combined_transfers else 0
        for register, value in self._access.read_each(sorted(expected)).items():
            if value != expected[register]:
                return f"{Register(register).name} reads 0x{value:02x}, was set to 0x{expected[register]:02x}"
        return ""

    def _recover(self, symptom: str) -> None:
        """Open the bus anew; restart the chip if it lost its configuration, or if this was tried since the last sample.

        Raises DeviceError if that is in vain.
        """
        newest_ns = self._stream.last_sample_ns
        tried, self._reopened_after_ns = self._reopened_after_ns == newest_ns, newest_ns
        try:
            self._connect()
            is_configured = not self._wrong_register()
        except OSError as error:
            self._fail(error)
        if tried:
            self._restart_idle_chip(symptom)
        elif not is_configured:
            self._restart()

    def _restart(self) -> None:
        """Reset and configure the chip."""
        try:
            self._start()
        except OSError as error:
            self._fail(error)
        self._counters.resets += 1

    def _restart_idle_chip(self, symptom: str) -> None:
        """Restart a chip that answers without working; raise DeviceError if it has not worked since the last start."""
        never_worked = not self._stream.works
        self._restart()
        if never_worked:
            self._fail_because(f"answers but {symptom}")

    def _fail(self, error: OSError) -> NoReturn:
        self._access.close()
        self._reopened_after_ns = None
        raise DeviceError(f"IMU at I2C address 0x{self._address:02x}: {error}") from error

    def _fail_because(self, why: str) -> NoReturn:
        self._fail(OSError(why))

    # Reading

    def _read_now(self) -> list[ImuSample]:
        """Return what the chip has now; empty after mending."""
        if self._access.is_open:
            try:
                return self._poll()
            except OSError as error:
                self._recover(str(error))
        else:
            self._recover("does not come back")
        return []

    def _poll(self) -> list[ImuSample]:
        now_ns = self._clock()
        if now_ns - self._checked_ns > _CHECK_EVERY_NS:
            self._checked_ns = now_ns
            if self._wrong_register():
                self._restart()
                return []
        return self._read_fifo() if self._access.has_combined_transfers else self._read_outputs()

    def _read_outputs(self) -> list[ImuSample]:
        """Take the sample in the output registers; after a late poll, look again if it is in doubt which one it is."""
        data, t_before_ns, t_after_ns = new_output(self._access, self._clock)
        if not data:
            return self._on_nothing_new(t_before_ns)
        ambiguous_s = self._stream.ambiguous_s(t_before_ns)
        if ambiguous_s > 0.0:
            self._sleep(ambiguous_s)
            further, t_before_ns, t_after_ns = new_output(self._access, self._clock)
            data += further
        return self._samples(data, t_before_ns, t_after_ns)

    def _read_fifo(self) -> list[ImuSample]:
        """Drain the FIFO. A broken burst is tried again if the FIFO still holds whole frames."""
        fifo_bytes = self._stream.configuration.chip.fifo_bytes
        for _ in range(ATTEMPTS):
            count, t_before_ns, t_after_ns = fifo_count(self._access, self._clock)
            if count > fifo_bytes:
                self._counters.bus_errors += 1
                raise OSError(errno.EIO, f"FIFO_COUNT reads {count}, the FIFO holds {fifo_bytes}")
            room_frames = (fifo_bytes - count) // FRAME.size
            if count % FRAME.size or room_frames <= _MIN_ROOM_FRAMES:
                return self._flush()
            if count == 0:
                return self._on_nothing_new(t_before_ns)
            try:
                data = self._access.burst(Register.FIFO_R_W, count)
            except OSError as error:
                fault = error
                continue
            held_up_s = 1e-9 * (self._clock() - t_before_ns) - count * _FASTEST_BYTE_S
            if held_up_s > room_frames * self.period_s:
                return self._flush()  # it may have overflowed before the burst began
            return self._samples(data, t_before_ns, t_after_ns)
        raise fault

    def _flush(self) -> list[ImuSample]:
        """Discard what the FIFO holds, halfway between two samples so that no doubt remains which were lost."""
        self._counters.fifo_overflows += 1
        self._sleep(self._stream.until_mid_period_s())
        self._discard_waiting()
        return []

    def _discard_waiting(self) -> int:
        """Empty the FIFO, or forget a waiting data-ready; return the time right before."""
        if self._access.has_combined_transfers:
            self._access.write_byte(Register.USER_CTRL, UserControl.FIFO_RESET)
            t_before_ns = self._clock()
            self._access.write_byte(Register.USER_CTRL, UserControl.FIFO_EN)
        else:
            t_before_ns = self._clock()
            self._access.read_byte(Register.INT_STATUS)
        self._stream.discarded_at((t_before_ns + self._clock()) // 2)
        self._wait.waiting()  # those edges belong to samples nobody will see
        return t_before_ns

    def _on_nothing_new(self, t_ns: int) -> list[ImuSample]:
        """Note that no sample had come at `t_ns`; check the chip if none has come for long."""
        stream = self._stream
        stream.none_new_at(t_ns)
        silent_periods = stream.silent_periods(t_ns)
        if silent_periods > _STALL_PERIODS:
            self._restart_idle_chip("delivers no samples")
        elif silent_periods > _CHECK_SILENCE_PERIODS and self._checked_silence_ns < stream.last_sample_ns:
            self._checked_silence_ns = t_ns
            if wrong := self._wrong_register():
                self._restart_idle_chip(wrong)
        return []

    def _samples(self, data: bytes, t_before_ns: int, t_after_ns: int) -> list[ImuSample]:
        """Turn the frames taken at an instant between the two times into samples."""
        frames = split(data)
        if self._stream.lacks_edges(len(frames)):
            self._stream.add_edges(self._wait.waiting())  # that came while the chip was read
        samples = self._stream.add_frames(frames, t_before_ns, t_after_ns)
        if self._stream.is_frozen:
            self._restart_idle_chip("its samples never change")
        return samples
