"""A serial CAN adapter on a pseudo-terminal, the ankle on its bus, and all that can be wrong with both.

The daemon opens `path`, a lasting name as /dev/serial/by-id/* are. The adapter speaks slcan and hands every frame of
the daemon to the campaign's receiver.
"""

import os
import random
import re
import select
import time
import tty
from collections.abc import Iterator
from pathlib import Path

from drivers.can.settings import CanInterface, CanSettings
from messages import AnkleState, GaitPhase
from messages.can_encoder import CanEncoder
from messages.can_frames import CanFrame, CanMessage, can_id

ANKLE_PERIOD_NS = 20_000_000
_FOREIGN_ID = 0x321
_TAKEN_IDS = tuple(map(can_id, (CanMessage.ANKLE_STATE, CanMessage.GROUND, CanMessage.GROUND_QUALITY)))
_FLOOD_FRAMES = 40
_GARBAGE_BYTES = 200
_LONGEST_PARTIAL = 64
_FRAME = re.compile(rb"t([0-9A-F]{3})([0-8])([0-9A-F]*)")


class SimulatedCanAdapter:
    """Serves the far end of the daemon's serial port; `serve` is called over and over by one thread.

    While `stuck` the adapter takes nothing. `flooding` adds foreign frames, `sending_garbage` bytes that are no frames;
    `ankle_corrupted` flips a bit in each state of the ankle, `ankle_replayed` sends one state over and over. With
    `identifiers_taken` another device sends its own data under the identifiers of the ankle's state and of the ground.
    """

    def __init__(self, path: Path) -> None:
        self.stuck = self.flooding = self.sending_garbage = self.ankle_corrupted = self.ankle_replayed = False
        self.identifiers_taken = False
        self._path = path
        self._partial = b""
        self._encoder = CanEncoder()
        self._last_ankle = self._encoder.ankle(_standing())
        self._ankle_due_ns = 0
        self._rng = random.Random(5)
        self._ends: tuple[int, int] | None = None
        self.plug_in()

    @property
    def settings(self) -> CanSettings:
        """Return how a CanLink reaches this bus."""
        return CanSettings(interface=CanInterface.SLCAN, channel=str(self._path), settle_s=0.0)

    def plug_in(self) -> None:
        """Let the port appear, if it is not there."""
        if self._ends is None:
            near, far = os.openpty()
            tty.setraw(far)
            os.set_blocking(near, False)
            self._ends = near, far
            self._path.unlink(missing_ok=True)
            self._path.symlink_to(os.ttyname(far))

    def unplug(self) -> None:
        """Let the port vanish: whoever has it open gets errors from now on."""
        if self._ends is not None:
            self._path.unlink(missing_ok=True)
            for end in self._ends:
                os.close(end)
            self._ends = None
            self._partial = b""

    def serve(self, timeout_s: float) -> Iterator[CanFrame]:
        """Send what the bus has for the daemon and yield the daemon's frames that came within `timeout_s`."""
        if self._ends is None:
            time.sleep(timeout_s)
            return
        yield from self._send_traffic(self._ends[0])
        if self.stuck:
            time.sleep(timeout_s)
            return
        if select.select([self._ends[0]], [], [], timeout_s)[0]:
            yield from self._frames_in(os.read(self._ends[0], 4096))

    def discard(self) -> None:
        """Drop what the daemon has sent and nobody has read: a receiver would take it for as new as when it is read."""
        self._partial = b""
        while self._ends is not None and select.select([self._ends[0]], [], [], 0.0)[0]:
            os.read(self._ends[0], 4096)

    def _send_traffic(self, port: int) -> Iterator[CanFrame]:
        """Send what is due to the daemon, and yield of it what others on the bus may take for the daemon's."""
        now_ns = time.monotonic_ns()
        if now_ns < self._ankle_due_ns:
            return
        self._ankle_due_ns = max(self._ankle_due_ns, now_ns - ANKLE_PERIOD_NS) + ANKLE_PERIOD_NS
        frames = [self._ankle()]
        if self.flooding:
            frames += [CanFrame(_FOREIGN_ID, bytes(range(8)))] * _FLOOD_FRAMES
        taken = [CanFrame(can_id, self._rng.randbytes(8)) for can_id in _TAKEN_IDS if self.identifiers_taken]
        frames += taken
        data = b"".join(_line(frame) for frame in frames)
        if self.sending_garbage:
            data += self._rng.randbytes(_GARBAGE_BYTES)
        try:
            os.write(port, data)
        except BlockingIOError:  # the daemon does not read for now; a bus has no memory either
            return
        yield from taken

    def _ankle(self) -> CanFrame:
        if not self.ankle_replayed:
            self._last_ankle = self._encoder.ankle(_standing())
        frame = self._last_ankle
        if self.ankle_corrupted:
            flipped = self._rng.randrange(8)
            frame = CanFrame(frame.can_id, bytes([frame.data[0] ^ 1 << flipped]) + frame.data[1:])
        return frame

    def _frames_in(self, received: bytes) -> Iterator[CanFrame]:
        *lines, rest = (self._partial + received).split(b"\r")
        self._partial = rest[-_LONGEST_PARTIAL:]
        for line in lines:
            found = _FRAME.fullmatch(line)
            if found and len(found[3]) == 2 * int(found[2]):
                yield CanFrame(int(found[1], 16), bytes.fromhex(found[3].decode("ascii")))


def _line(frame: CanFrame) -> bytes:
    return f"t{frame.can_id:03X}{len(frame.data)}{frame.data.hex().upper()}\r".encode("ascii")


def _standing() -> AnkleState:
    return AnkleState(t_sample_ns=0, ankle_angle_rad=0.1, ankle_rate_radps=0.0, load_n=400.0, phase=GaitPhase.STANCE)
