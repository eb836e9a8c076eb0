"""An MPU-6050 behind its registers, driven by a motion and a clock. A driver cannot tell it from hardware.

Source: InvenSense MPU-6000/MPU-6050 Register Map and Descriptions. Modelled: the registers of
`drivers.mpu6050_registers`, sleep after reset, clock sources, rate divider, filter with its delay, ranges with
clipping, FIFO with overflow, interrupts, temperature, noise, bias and clock error. Not modelled: I2C master, motion
detection, self-test, cycle and standby modes (their registers read 0 and ignore writing).
"""

from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from drivers.mpu6050_registers import (
    ACCEL_RANGES,
    FIFO_BYTES,
    FILTER_ROWS,
    GYRO_RANGES,
    MPU6050_WHO_AM_I,
    FifoEnable,
    Interrupt,
    InterruptPin,
    Power,
    Register,
    UserControl,
)
from sim_rig.imu.chip_unit import ChipUnit
from sim_rig.imu.mpu6050_signal import Motion, SignalChain, SignalSettings

_WRITABLE_BITS: dict[int, int] = {  # the rest reads 0
    Register.SMPLRT_DIV: 0xFF,
    Register.CONFIG: 0x3F,
    Register.GYRO_CONFIG: 0xF8,
    Register.ACCEL_CONFIG: 0xF8,
    Register.FIFO_EN: 0xFF,
    Register.INT_PIN_CFG: 0xFE,
    Register.INT_ENABLE: 0x19,
    Register.USER_CTRL: 0x70,
    Register.PWR_MGMT_1: 0x6F,
}
_SIGNAL_REGISTERS = (
    Register.SMPLRT_DIV,
    Register.CONFIG,
    Register.GYRO_CONFIG,
    Register.ACCEL_CONFIG,
    Register.PWR_MGMT_1,
)
_CLOCK_SOURCE = 0x07
_CLOCK_ERROR_GAIN = {  # of the PLL's error: the internal oscillator is ±5 % where the PLL is ±1 %
    Power.INTERNAL_OSCILLATOR: 5.0,
    Power.PLL_GYRO_X: 1.0,
    Power.PLL_GYRO_X + 1: 1.0,
    Power.PLL_GYRO_X + 2: 1.0,
}
_FIFO_COLUMNS = (  # of a sample's seven counts, in the order of the output registers
    (FifoEnable.ACCEL, (0, 1, 2)),
    (FifoEnable.TEMPERATURE, (3,)),
    (FifoEnable.GYRO_X, (4,)),
    (FifoEnable.GYRO_Y, (5,)),
    (FifoEnable.GYRO_Z, (6,)),
)
_REGISTERS = 128
_OUTPUT_BYTES = 14
_MAX_BACKLOG = FIFO_BYTES // 2  # samples of the shortest kind that the FIFO can hold; older ones leave no trace


class Mpu6050Chip:
    """One simulated chip, powered since its making and asleep like a real one.

    `motion` is the truth, `unit` this chip's errors, `clock` the host's monotonic nanoseconds: whatever is read
    reflects the samples complete at that instant. For one thread at a time. `who_am_i` may be changed while it runs.
    """

    def __init__(
        self, motion: Motion, unit: ChipUnit, clock: Callable[[], int], seed: int, who_am_i: int = MPU6050_WHO_AM_I
    ) -> None:
        self.who_am_i = who_am_i
        self._motion = motion
        self._unit = unit
        self._clock = clock
        self._rng = np.random.default_rng(seed)
        self._edges: deque[int] = deque(maxlen=_MAX_BACKLOG)
        self._held = b""
        self._reset()

    # The bus's side: a write sets the register pointer, then registers; a read continues from the pointer.

    def write(self, data: bytes) -> None:
        """Take one write transfer: a register address, then values for it and the registers after it."""
        self._advance()
        if data:
            self._pointer = data[0] % _REGISTERS
        for value in data[1:]:
            self._write_register(self._pointer, value)
            self._increment_pointer()

    def read(self, length: int) -> bytes:
        """Answer one read transfer of `length` bytes, all from the same instant, from the register pointer on."""
        self._advance()
        data = bytearray()
        for _ in range(length):
            data.append(self._read_register(self._pointer))
            self._increment_pointer()
        if self._registers[Register.INT_PIN_CFG] & InterruptPin.CLEAR_ON_ANY_READ:
            self._interrupts = 0
        return bytes(data)

    # The rig's side

    def take_edges(self) -> list[int]:
        """Return the instants of the INT pin's edges since the last call, oldest first; the newest 512 are kept."""
        self._advance()
        edges = list(self._edges)
        self._edges.clear()
        return edges

    @property
    def period_ns(self) -> float:
        """Return the true period of the chip's samples as it is set up now; NaN while it sleeps."""
        return float("nan") if self._chain is None else self._chain.period_ns

    def brown_out(self) -> None:
        """Lose power for a moment: all registers at their reset values, asleep, no error on the bus."""
        self._reset()

    def freeze(self, frozen: bool = True) -> None:
        """Hold (or release) the sensor values while all else goes on: a hung signal chain that no reset wakes."""
        self._held = self._outputs if frozen else b""

    def _reset(self) -> None:
        self._registers = bytearray(_REGISTERS)
        self._registers[Register.PWR_MGMT_1] = Power.SLEEP
        self._outputs = bytes(_OUTPUT_BYTES)
        self._fifo = bytearray()
        self._last_fifo_byte = 0
        self._interrupts = 0
        self._pointer = 0
        self._chain: SignalChain | None = None
        self._completed = 0

    def _increment_pointer(self) -> None:
        if self._pointer != Register.FIFO_R_W:
            self._pointer = (self._pointer + 1) % _REGISTERS

    def _read_register(self, register: int) -> int:
        if register == Register.WHO_AM_I:
            return self.who_am_i
        if register == Register.FIFO_R_W:
            return self._pop_fifo()
        if register == Register.INT_STATUS:
            status, self._interrupts = self._interrupts, 0
            return status
        if Register.ACCEL_XOUT_H <= register < Register.ACCEL_XOUT_H + _OUTPUT_BYTES:
            return self._outputs[register - Register.ACCEL_XOUT_H]
        if register == Register.FIFO_COUNTH:
            return len(self._fifo) >> 8
        if register == Register.FIFO_COUNTH + 1:
            return len(self._fifo) & 0xFF
        return self._registers[register]

    def _write_register(self, register: int, value: int) -> None:
        if register == Register.PWR_MGMT_1 and value & Power.DEVICE_RESET:
            self._reset()
            return
        if register == Register.USER_CTRL and value & UserControl.FIFO_RESET and not value & UserControl.FIFO_EN:
            self._fifo.clear()
        before = self._registers[register]
        self._registers[register] = value & _WRITABLE_BITS.get(register, 0)
        if register in _SIGNAL_REGISTERS and self._registers[register] != before:
            self._restart_signal()

    def _restart_signal(self) -> None:
        """Begin sampling anew, now, with the registers as they are."""
        power = self._registers[Register.PWR_MGMT_1]
        filter_row = FILTER_ROWS.get(self._registers[Register.CONFIG] & 0x07)
        gain = _CLOCK_ERROR_GAIN.get(power & _CLOCK_SOURCE)
        self._chain = None
        self._completed = 0
        if power & Power.SLEEP or gain is None or filter_row is None:
            return
        settings = SignalSettings(
            filter_row=filter_row,
            accel_range=list(ACCEL_RANGES.values())[self._registers[Register.ACCEL_CONFIG] >> 3 & 0x03],
            gyro_range=list(GYRO_RANGES.values())[self._registers[Register.GYRO_CONFIG] >> 3 & 0x03],
            divider=self._registers[Register.SMPLRT_DIV],
        )
        clock_error = gain * self._unit.clock_error
        self._chain = SignalChain(self._motion, self._unit, settings, self._clock(), clock_error, self._rng)

    def _advance(self) -> None:
        """Let the samples happen that have become complete since the last look."""
        if self._chain is None:
            return
        completed = self._chain.completed_at(self._clock())
        if completed == self._completed:
            return
        if completed - self._completed > _MAX_BACKLOG:
            self._chain.skip(completed - _MAX_BACKLOG - self._completed)
            self._completed = completed - _MAX_BACKLOG
        counts = self._chain.take(completed - self._completed)
        first, self._completed = self._completed + 1, completed
        if self._held:
            counts = np.tile(np.frombuffer(self._held, dtype=">i2"), (len(counts), 1))
        self._outputs = counts[-1].astype(">i2").tobytes()
        self._push_fifo(counts)
        self._raise_data_ready(first)

    def _push_fifo(self, counts: NDArray[np.int16]) -> None:
        if not self._registers[Register.USER_CTRL] & UserControl.FIFO_EN:
            return
        enabled = self._registers[Register.FIFO_EN]
        columns = [column for bit, group in _FIFO_COLUMNS if enabled & bit for column in group]
        self._fifo += counts[:, columns].astype(">i2").tobytes()
        if len(self._fifo) > FIFO_BYTES:
            del self._fifo[:-FIFO_BYTES]
            self._interrupts |= Interrupt.FIFO_OVERFLOW & self._registers[Register.INT_ENABLE]

    def _pop_fifo(self) -> int:
        if self._fifo:
            self._last_fifo_byte = self._fifo.pop(0)
        return self._last_fifo_byte

    def _raise_data_ready(self, first: int) -> None:
        if self._chain is None or not self._registers[Register.INT_ENABLE] & Interrupt.DATA_READY:
            return
        edges = self._chain.sample_times_ns(first, self._completed).tolist()
        if self._registers[Register.INT_PIN_CFG] & InterruptPin.LATCHED:
            edges = [] if self._interrupts & Interrupt.DATA_READY else edges[:1]
        self._edges.extend(edges)
        self._interrupts |= Interrupt.DATA_READY
