"""An MPU-6050, or a relative, behind its registers, driven by a motion and a clock. It passes for hardware.

Source: InvenSense MPU-6000/MPU-6050 Register Map and Descriptions, and `drivers.imu.chips` for what differs.
Modelled: the registers of `drivers.imu.registers`, sleep after reset, clock sources, rate divider, filters with
their delays, ranges with clipping, FIFO with overflow, interrupts, temperature, noise, bias, clock error, self-test
and standby of single axes. Not modelled: I2C master, motion detection and cycle mode (their registers read 0 and
ignore writing).
"""

from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from drivers.imu.chips import CHIPS, MPU6050_WHO_AM_I
from drivers.imu.registers import (
    ACCEL_RANGES,
    GYRO_RANGES,
    FifoEnable,
    Interrupt,
    InterruptPin,
    Power,
    Register,
    UserControl,
)
from drivers.imu.self_test import factory_trim_lsb, ranges_under_test
from messages.arrays import BoolArray, FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2
from sim_rig.imu.chip_unit import ChipUnit
from sim_rig.imu.drift import NO_DRIFT, Drifting
from sim_rig.imu.mpu6050_signal import Motion, SignalChain, SignalSettings

_WRITABLE_BITS: dict[int, int] = {  # the rest reads 0
    Register.SMPLRT_DIV: 0xFF,
    Register.CONFIG: 0x3F,
    Register.GYRO_CONFIG: 0xF8,
    Register.ACCEL_CONFIG: 0xF8,
    Register.ACCEL_CONFIG_2: 0xCF,
    Register.FIFO_EN: 0xFF,
    Register.INT_PIN_CFG: 0xFE,
    Register.INT_ENABLE: 0x19,
    Register.USER_CTRL: 0x70,
    Register.PWR_MGMT_1: 0x6F,
    Register.PWR_MGMT_2: 0x3F,
}
_SIGNAL_REGISTERS = (
    Register.SMPLRT_DIV,
    Register.CONFIG,
    Register.GYRO_CONFIG,
    Register.ACCEL_CONFIG,
    Register.ACCEL_CONFIG_2,
    Register.PWR_MGMT_1,
    Register.PWR_MGMT_2,
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
_SHORTEST_FRAME_BYTES = 2
_FIFO_SIZES = (512, 1024, 2048, 4096)  # by ACCEL_CONFIG_2 bits 7:6, where the chip has that choice


class Mpu6050Chip:
    """One simulated chip, powered since its making and as a real one is after a reset: an MPU-6050 is asleep.

    `who_am_i` chooses which of `drivers.imu.chips` it is; any other value makes an MPU-6050 that answers so.
    Changed while it runs, it changes the answer alone. `motion` is the truth, `unit` this chip's errors, `drifting` how
    they change, `clock` the host's monotonic nanoseconds: whatever is read reflects the samples complete at that
    instant. `distortion`, which may also change, turns the counts (n, 7) of the signal chain into those shown. For one
    thread at a time.
    """

    distortion: Callable[[NDArray[np.int16]], NDArray[np.int16]] | None = None

    def __init__(
        self,
        motion: Motion,
        unit: ChipUnit,
        clock: Callable[[], int],
        seed: int,
        who_am_i: int = MPU6050_WHO_AM_I,
        drifting: Drifting | None = None,
    ) -> None:
        self.who_am_i = who_am_i
        self._model = CHIPS.get(who_am_i, CHIPS[MPU6050_WHO_AM_I])
        self._max_backlog = self._model.fifo_bytes // _SHORTEST_FRAME_BYTES  # older samples leave no trace
        self._motion = motion
        self._unit = unit
        self._drifting = drifting or Drifting(NO_DRIFT, 0)
        self._clock = clock
        self._rng = np.random.default_rng(seed)
        self._edges: deque[int] = deque(maxlen=self._max_backlog)
        self._held = b""
        self._clock_factor = 1.0
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
        """Return the instants of the INT pin's edges since the last call, oldest first.

        The newest are kept, as many as the FIFO has room for samples of one value: 512 in an MPU-6050.
        """
        self._advance()
        edges = list(self._edges)
        self._edges.clear()
        return edges

    def next_edge_ns(self) -> int | None:
        """Return when the INT pin will next rise if no register is touched meanwhile; None if it will not."""
        self._advance()
        if self._chain is None or not self._registers[Register.INT_ENABLE] & Interrupt.DATA_READY:
            return None
        if self._registers[Register.INT_PIN_CFG] & InterruptPin.LATCHED and self._interrupts & Interrupt.DATA_READY:
            return None
        return int(self._chain.sample_times_ns(self._completed + 1, self._completed + 1)[0])

    @property
    def period_ns(self) -> float:
        """Return the true period of the chip's samples as it is set up now; NaN while it sleeps."""
        return float("nan") if self._chain is None else self._chain.period_ns

    def brown_out(self) -> None:
        """Lose power for a moment: all registers at their reset values, asleep, no error on the bus."""
        self._reset()

    def set_clock(self, factor: float) -> None:
        """Let the chip's clock run `factor` times as fast as the unit's own from the next sample on."""
        change, self._clock_factor = factor / self._clock_factor, factor
        if self._chain is not None:
            self._chain.change_clock(change, self._completed)

    def freeze(self, frozen: bool = True) -> None:
        """Hold (or release) the sensor values while all else goes on: a hung signal chain that no reset restarts."""
        self._held = self._outputs if frozen else b""

    def _reset(self) -> None:
        self._registers = bytearray(_REGISTERS)
        self._registers[Register.PWR_MGMT_1] = self._model.power_at_reset
        for register, code in self._unit.trim_codes.registers(self._model).items():
            self._registers[register] = code
        self._outputs = bytes(_OUTPUT_BYTES)
        self._fifo = bytearray()
        self._last_fifo_byte = 0
        self._interrupts = 0
        self._pointer = 0
        self._restart_signal()

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
        if register not in _WRITABLE_BITS or (register == Register.ACCEL_CONFIG_2 and not self._model.has_accel_filter):
            return
        before = self._registers[register]
        self._registers[register] = value & _WRITABLE_BITS[register]
        if register in _SIGNAL_REGISTERS and self._registers[register] != before:
            self._restart_signal()

    def _restart_signal(self) -> None:
        """Begin sampling anew, now, with the registers as they are."""
        power = self._registers[Register.PWR_MGMT_1]
        rows = self._model.filter_rows
        gyro_row = rows.get(self._registers[Register.CONFIG] & 0x07)
        accel_row = (
            rows.get(self._registers[Register.ACCEL_CONFIG_2] & 0x07) if self._model.has_accel_filter else gyro_row
        )
        gain = _CLOCK_ERROR_GAIN.get(power & _CLOCK_SOURCE)
        self._chain: SignalChain | None = None
        self._completed = 0
        if power & Power.SLEEP or gain is None or gyro_row is None or accel_row is None:
            return
        push_sf_mps2, push_w_radps = self._pushes()
        settings = SignalSettings(
            model=self._model,
            accel_row=accel_row,
            gyro_row=gyro_row,
            accel_range=list(ACCEL_RANGES.values())[self._registers[Register.ACCEL_CONFIG] >> 3 & 0x03],
            gyro_range=list(GYRO_RANGES.values())[self._registers[Register.GYRO_CONFIG] >> 3 & 0x03],
            divider=self._registers[Register.SMPLRT_DIV],
            push_sf_mps2=push_sf_mps2,
            push_w_radps=push_w_radps,
            standby=_bits(self._registers[Register.PWR_MGMT_2], 5, 6),
        )
        clock_error = gain * self._unit.clock_error
        self._chain = SignalChain(
            self._motion, self._unit, self._drifting, settings, self._clock(), clock_error, self._rng
        )
        self._chain.change_clock(self._clock_factor, completed=0)

    def _pushes(self) -> tuple[FloatArray, FloatArray]:
        """Return the self-test's push (3,) on the accelerometer, in m/s², and (3,) on the gyroscope, in rad/s."""
        accel_range, gyro_range = ranges_under_test(self._model)
        response_lsb = np.array(factory_trim_lsb(self._model, self._unit.trim_codes)) * self._unit.push_share
        accel_lsb = np.where(_bits(self._registers[Register.ACCEL_CONFIG], 7, 3), response_lsb[:3], 0.0)
        gyro_lsb = np.where(_bits(self._registers[Register.GYRO_CONFIG], 7, 3), response_lsb[3:], 0.0)
        sf_mps2 = accel_lsb / accel_range.lsb_per_unit * STANDARD_GRAVITY_MPS2
        return sf_mps2, np.deg2rad(gyro_lsb / gyro_range.lsb_per_unit)

    def _advance(self) -> None:
        """Let the samples happen that have become complete since the last look."""
        if self._chain is None:
            return
        completed = self._chain.completed_at(self._clock())
        if completed == self._completed:
            return
        if completed - self._completed > self._max_backlog:
            self._chain.skip(completed - self._max_backlog - self._completed)
            self._completed = completed - self._max_backlog
        counts = self._chain.take(completed - self._completed)
        first, self._completed = self._completed + 1, completed
        if self.distortion is not None:
            counts = self.distortion(counts)
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
        if len(self._fifo) > self._fifo_bytes():
            del self._fifo[: -self._fifo_bytes()]
            self._interrupts |= Interrupt.FIFO_OVERFLOW & self._registers[Register.INT_ENABLE]

    def _fifo_bytes(self) -> int:
        if self._model.accel_config_2:
            return _FIFO_SIZES[self._registers[Register.ACCEL_CONFIG_2] >> 6]
        return self._model.fifo_bytes

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


def _bits(value: int, highest: int, count: int) -> BoolArray:
    """Return `count` bits from bit `highest` downwards."""
    return np.array([value >> (highest - place) & 1 for place in range(count)], dtype=np.bool_)
