"""AUTOSAR E2E profiles 2 (8 bytes) and 5 (CAN FD) on CAN frames: a CRC, a counter, and Data IDs that are not sent.

Source: AUTOSAR Foundation, E2E Protocol Specification, profiles 2 and 5.

Profile 2: a CRC in byte 0, a counter from 0 to 15 in the low nibble of byte 1. The CRC (CRC-8, polynomial 0x2F, start
and final XOR 0xFF, not reflected) runs over bytes 1 to n-1 and then over one byte that is not sent: the Data ID that
the message's own list of 16 gives for this counter. A frame of another message therefore fails the CRC.

Profile 5: a CRC in bytes 0 and 1, low byte first, a counter from 0 to 255 in byte 2. The CRC (CRC-16, polynomial
0x1021, start 0xFFFF, not reflected) runs over bytes 2 to n-1 and then over the message's Data ID, low byte first.

What remains: corruption of a random kind passes an 8-bit CRC once in 256, and must then also carry one of the
`max_delta` of 16 counters that are accepted next: about max_delta / 4096 of corrupted frames, 1 in 1365 for 3. Of
profile 5 it is max_delta / 2^24, 1 in 5.6 million.
"""

import enum

import msgspec
from crccheck.crc import Crc8Autosar, Crc16Autosar  # type: ignore[import-untyped]  # the package carries no type hints

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
    frames_per_cycle: int = 1

    @property
    def counters(self) -> int:
        """Return how many counters there are."""
        return COUNTERS

    def crc(self, data: bytes) -> int:
        """Return the CRC of `data` (`length` bytes, byte 0 ignored) for the counter that stands in it."""
        return int(Crc8Autosar.calc(data[1:] + bytes([self.data_ids[self.counter_of(data)]])))

    def counter_of(self, data: bytes) -> int:
        """Return the counter of a protected frame."""
        return data[1] & 0x0F

    def is_intact(self, data: bytes) -> bool:
        """Return whether the CRC in `data` is that of its bytes."""
        return data[0] == self.crc(data)

    def protected(self, payload: bytes, counter: int) -> bytes:
        """Return `payload` with this counter and the CRC written into it."""
        data = bytes([0, payload[1] & 0xF0 | counter]) + payload[2:]
        return bytes([self.crc(data)]) + data[1:]


class Profile5(msgspec.Struct, frozen=True, kw_only=True):
    """The protection of one message on CAN FD: its length, its Data ID, its cycle, the largest step of its counter."""

    length: int
    data_id: int
    max_delta: int
    cycle_s: float
    frames_per_cycle: int = 1

    @property
    def counters(self) -> int:
        """Return how many counters there are."""
        return 256

    def crc(self, data: bytes) -> int:
        """Return the CRC of `data` (`length` bytes, bytes 0 and 1 ignored)."""
        return int(Crc16Autosar.calc(data[2:] + self.data_id.to_bytes(2, "little")))

    def counter_of(self, data: bytes) -> int:
        """Return the counter of a protected frame."""
        return data[2]

    def is_intact(self, data: bytes) -> bool:
        """Return whether the CRC in `data` is that of its bytes."""
        return int.from_bytes(data[:2], "little") == self.crc(data)

    def protected(self, payload: bytes, counter: int) -> bytes:
        """Return `payload` with this counter and the CRC written into it."""
        data = bytes([0, 0, counter]) + payload[3:]
        return self.crc(data).to_bytes(2, "little") + data[2:]


Profile = Profile2 | Profile5


class E2eSender:
    """Protects the frames of one message in the order in which they are sent."""

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._counter = 0

    def protect(self, payload: bytes) -> bytes:
        """Return `payload` with the next counter and the CRC written into it."""
        self._counter = (self._counter + 1) % self._profile.counters
        return self._profile.protected(payload, self._counter)


class E2eReceiver:
    """Checks the frames of one message in the order in which they arrive."""

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        # Half a cycle of grace, because frames jitter. After more than that the counter may have wrapped.
        unwrapped = (profile.counters - profile.max_delta) // profile.frames_per_cycle
        self._silence_ns = round(1e9 * (min(profile.max_delta, unwrapped) + 0.5) * profile.cycle_s)
        self._last: tuple[int, int] | None = None

    def check(self, data: bytes, t_ns: int) -> E2eCheck:
        """Return what is wrong with `data` received at `t_ns`, or OK.

        A frame with a wrong CRC leaves the sequence as it was.
        """
        if len(data) != self._profile.length:
            return E2eCheck.WRONG_LENGTH
        if not self._profile.is_intact(data):
            return E2eCheck.WRONG_CRC
        counter, last = self._profile.counter_of(data), self._last
        self._last = counter, t_ns
        if last is None or t_ns - last[1] > self._silence_ns:
            return E2eCheck.INITIAL
        delta = (counter - last[0]) % self._profile.counters
        if delta == 0:
            return E2eCheck.REPEATED
        return E2eCheck.OK if delta <= self._profile.max_delta else E2eCheck.WRONG_SEQUENCE
