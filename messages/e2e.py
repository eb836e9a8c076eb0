"""AUTOSAR E2E profile 2 on CAN frames: a CRC in byte 0, a counter from 0 to 15 in the low nibble of byte 1.

Source: AUTOSAR Foundation, E2E Protocol Specification, profile 2. The CRC (CRC-8, polynomial 0x2F, start and
final XOR 0xFF, not reflected) runs over bytes 1 to n-1 and then over one byte that is not sent: the Data ID that
the message's own list of 16 gives for this counter. A frame of another message therefore fails the CRC.

What remains: corruption of a random kind passes an 8-bit CRC once in 256, and must then also carry one of the
`max_delta` of 16 counters that are accepted next: about max_delta / 4096 of corrupted frames, 1 in 1365 for 3.
Where that matters, profile 5 (CRC-16) on CAN FD is the remedy, not a longer look at this one.
"""

import enum

import msgspec
from crccheck.crc import Crc8Autosar  # type: ignore[import-untyped]  # the package carries no type hints

COUNTERS = 16


class E2eCheck(str, enum.Enum):
    """What the check of one received frame found; only OK may be used."""

    OK = "ok"
    INITIAL = "initial"  # the first frame, or the first after a silence: nothing to judge its counter against
    WRONG_LENGTH = "wrong_length"
    WRONG_CRC = "wrong_crc"
    REPEATED = "repeated"  # the counter stood still
    WRONG_SEQUENCE = "wrong_sequence"  # the counter jumped; the next frame is judged against this one


class Profile2(msgspec.Struct, frozen=True, kw_only=True):
    """The protection of one message: its length, its 16 Data IDs, its cycle, the largest step of its counter."""

    length: int
    data_ids: bytes
    max_delta: int
    cycle_s: float

    def crc(self, data: bytes) -> int:
        """Return the CRC of `data` (`length` bytes, byte 0 ignored) for the counter that stands in it."""
        return int(Crc8Autosar.calc(data[1:] + bytes([self.data_ids[counter_of(data)]])))


def counter_of(data: bytes) -> int:
    """Return the counter of a protected frame."""
    return data[1] & 0x0F


class E2eSender:
    """Protects the frames of one message in the order in which they are sent."""

    def __init__(self, profile: Profile2) -> None:
        self._profile = profile
        self._counter = 0

    def protect(self, payload: bytes) -> bytes:
        """Return `payload` with the next counter and the CRC written into it."""
        self._counter = (self._counter + 1) % COUNTERS
        data = bytes([0, payload[1] & 0xF0 | self._counter]) + payload[2:]
        return bytes([self._profile.crc(data)]) + data[1:]


class E2eReceiver:
    """Checks the frames of one message in the order in which they arrive."""

    def __init__(self, profile: Profile2) -> None:
        self._profile = profile
        # Half a cycle of grace, because frames jitter. After more than that the counter may have wrapped.
        self._silence_ns = round(1e9 * (profile.max_delta + 0.5) * profile.cycle_s)
        self._last: tuple[int, int] | None = None

    def check(self, data: bytes, t_ns: int) -> E2eCheck:
        """Return what is wrong with `data` received at `t_ns`, or OK.

        A frame with a wrong CRC leaves the sequence as it was.
        """
        if len(data) != self._profile.length:
            return E2eCheck.WRONG_LENGTH
        if data[0] != self._profile.crc(data):
            return E2eCheck.WRONG_CRC
        counter, last = counter_of(data), self._last
        self._last = counter, t_ns
        if last is None or t_ns - last[1] > self._silence_ns:
            return E2eCheck.INITIAL
        delta = (counter - last[0]) % COUNTERS
        if delta == 0:
            return E2eCheck.REPEATED
        return E2eCheck.OK if delta <= self._profile.max_delta else E2eCheck.WRONG_SEQUENCE
