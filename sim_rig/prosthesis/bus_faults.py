"""What a CAN bus may do to frames, on demand: lose them, deliver them late, and carry a node that babbles."""

from collections import deque
from collections.abc import Iterator
from typing import Annotated, NamedTuple

import msgspec
import numpy as np

from messages import UserError
from messages.can_frames import CanFrame, CanMessage, can_id


class BusFaults(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Share of frames lost, `delay_s` added to each, and frames a second of a node that babbles."""

    loss: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.0
    delay_s: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.0
    babble_hz: Annotated[float, msgspec.Meta(ge=0.0, le=4000.0)] = 0.0


def parse_faults(text: str) -> BusFaults:
    """Return the faults of "loss=0.05,delay_s=0.02,babble_hz=500"; an empty text means none.

    Raises UserError for anything else.
    """
    pairs = [part.partition("=")[::2] for part in text.split(",") if part.strip()]
    try:
        return msgspec.convert({name.strip(): float(value) for name, value in pairs}, BusFaults)
    except (ValueError, msgspec.ValidationError) as error:
        raise UserError(
            f"bus faults: '{text}' is not as in loss=0.05,delay_s=0.02,babble_hz=500 (a share from 0 to 1, at most 1 s "
            f"and 4000 frames/s): {error}"
        ) from error


class Arrived(NamedTuple):
    """A frame, and when it arrives."""

    t_ns: int
    frame: CanFrame


class FaultyWay:
    """One way of the bus, from a sender to a receiver: what is put in comes out in its order, late or never."""

    def __init__(self, faults: BusFaults, seed: int) -> None:
        self.lost = 0
        self._faults = faults
        self._chance = np.random.default_rng([seed, 41])
        self._delay_ns = round(1e9 * faults.delay_s)
        self._waiting: deque[Arrived] = deque()

    def put(self, frame: CanFrame, t_ns: int) -> None:
        """Take a frame sent at `t_ns`."""
        if self._chance.random() < self._faults.loss:
            self.lost += 1
        else:
            self._waiting.append(Arrived(t_ns + self._delay_ns, frame))

    def due(self, t_ns: int) -> Iterator[Arrived]:
        """Yield what has arrived by `t_ns`."""
        while self._waiting and self._waiting[0].t_ns <= t_ns:
            yield self._waiting.popleft()


class Babbler:
    """A node that sends random bytes under the identifiers of others, at even intervals from `start_ns` on."""

    def __init__(self, faults: BusFaults, seed: int, start_ns: int) -> None:
        self._chance = np.random.default_rng([seed, 42])
        self._period_ns = round(1e9 / faults.babble_hz) if faults.babble_hz else 0
        self._next_ns = start_ns

    def due(self, t_ns: int) -> Iterator[CanFrame]:
        """Yield what it has sent by `t_ns`."""
        while self._period_ns and self._next_ns <= t_ns:
            self._next_ns += self._period_ns
            identifier = _IDENTIFIERS[int(self._chance.integers(len(_IDENTIFIERS)))]
            yield CanFrame(identifier, self._chance.bytes(8))


_IDENTIFIERS = [can_id(message) for message in CanMessage if message is not CanMessage.SETPOINT_FD]
