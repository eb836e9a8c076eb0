"""Frames of an MPU-6050, the fourteen bytes of its output registers: reading, checking and decoding them."""

import errno
import struct
from collections.abc import Callable, Sequence

from drivers.imu.register_access import RegisterAccess
from drivers.imu.registers import Interrupt, Register
from drivers.imu.settings import Configuration
from messages import ImuSample

FRAME = struct.Struct(">7h")
"""Accelerometer xyz, temperature, gyroscope xyz, as the output registers stand."""

_CLIPPED = (-32768, 32767)


def new_output(access: RegisterAccess, clock: Callable[[], int]) -> tuple[bytes, int, int]:
    """Return the output registers if they are new, else nothing, and the times before and after. Raises OSError.

    INT_STATUS stands right before them and one burst is from one instant, so the two belong together.
    """
    t_before_ns = clock()
    block = access.read(Register.INT_STATUS, 1 + FRAME.size)
    t_after_ns = clock()
    return (block[1:] if block[0] & Interrupt.DATA_READY else b""), t_before_ns, t_after_ns


def fifo_count(access: RegisterAccess, clock: Callable[[], int]) -> tuple[int, int, int]:
    """Return the bytes in the FIFO and the times before and after; once more if a frame seems half written.

    Raises OSError.
    """
    for _ in range(2):
        t_before_ns = clock()
        count = access.read_word(Register.FIFO_COUNTH)
        t_after_ns = clock()
        if count % FRAME.size == 0:
            break
    return count, t_before_ns, t_after_ns


def split(data: bytes) -> list[bytes]:
    """Return the frames of a burst."""
    return [data[i : i + FRAME.size] for i in range(0, len(data), FRAME.size)]


def refuse_without_data(frames: Sequence[bytes]) -> None:
    """Raise OSError (EIO) if all bytes of a frame are the same.

    So read a chip that sleeps (zeros), a data line nobody drives (ones) and a FIFO that is empty after all (its last
    byte over and over). No chip at work says that: all axes and the temperature would read the same.
    """
    for frame in frames:
        if frame.count(frame[0]) == FRAME.size:
            raise OSError(errno.EIO, f"samples of 0x{frame[0]:02x} alone, as no chip at work gives")


class FreezeDetector:
    """Detects a hung signal chain: its frames repeat, which the noise of a working one prevents.

    After `reset`, no frame counts as changing before one has come that differs from its predecessor.
    """

    def __init__(self, frozen_frames: int) -> None:
        self._frozen_frames = frozen_frames
        self._last = b""
        self._equal = 0
        self._changed = False

    def reset(self) -> None:
        """Begin anew after the chip was mended; the last frame from before is still remembered."""
        self._equal, self._changed = 0, False

    def changing(self, frames: Sequence[bytes]) -> list[bool]:
        """Take the frames that came next and return of each whether any has changed since the restart."""
        return [self._has_changed(frame) for frame in frames]

    @property
    def is_frozen(self) -> bool:
        """Return whether too many frames in a row were the same."""
        return self._equal >= self._frozen_frames

    def _has_changed(self, frame: bytes) -> bool:
        self._equal = self._equal + 1 if frame == self._last else 1
        self._changed = self._changed or frame != self._last
        self._last = frame
        return self._changed


def decode(
    frame: bytes, configuration: Configuration, *, seq: int, t_ready_ns: int, t_arrival_ns: int, lost_before: int
) -> ImuSample:
    """Return what the frame says in SI units; `t_ready_ns` is its data-ready instant."""
    raw = FRAME.unpack(frame)
    sf, temperature, w = raw[0:3], raw[3], raw[4:7]
    mps2, radps = configuration.mps2_per_lsb, configuration.radps_per_lsb
    return ImuSample(
        seq=seq,
        t_sample_ns=t_ready_ns - round(configuration.filter_row.delay_s * 1e9),
        t_arrival_ns=t_arrival_ns,
        sf_B_mps2=(sf[0] * mps2, sf[1] * mps2, sf[2] * mps2),
        w_WB_B_radps=(w[0] * radps, w[1] * radps, w[2] * radps),
        temperature_degC=configuration.chip.temperature_degC(temperature),
        clipped=any(value in _CLIPPED for value in sf + w),
        lost_before=lost_before,
    )
