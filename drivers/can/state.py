"""What the error frames of SocketCAN tell about the controller: active, passive, bus-off.

Source: Linux `include/uapi/linux/can/error.h` (error classes in the identifier, controller states in data[1]) and
ISO 11898-1 (fault confinement). A controller that is off sends nothing until it is restarted, by the `restart-ms` of
its link or by hand; frames queued meanwhile would go out late, so `may_send` holds them back.
"""

import enum

import can

from messages import CanState

PROBE_PAUSE_NS = 1_000_000_000


class _ErrorClass(enum.IntFlag):
    CONTROLLER = 0x004
    BUS_OFF = 0x040
    RESTARTED = 0x100


_STATES_OF_THE_CONTROLLER = (  # data[1], the gravest first
    (0x30, CanState.PASSIVE),  # receiving or sending
    (0x0C, CanState.WARNING),
    (0x40, CanState.ACTIVE),
)


class CanStateWatch:
    """Follows the controller's state. One thread may tell it what was received, another ask `may_send`."""

    def __init__(self) -> None:
        self.state = CanState.ACTIVE
        self.bus_offs = 0
        self._probe_ns = 0

    def on_error_frame(self, frame: can.Message, now_ns: int) -> None:
        """Take one error frame."""
        classes = frame.arbitration_id
        if classes & _ErrorClass.BUS_OFF:
            self.bus_offs += self.state is not CanState.BUS_OFF
            self.state = CanState.BUS_OFF
            self._probe_ns = now_ns + PROBE_PAUSE_NS
        elif classes & _ErrorClass.RESTARTED:
            self.state = CanState.ACTIVE
        elif classes & _ErrorClass.CONTROLLER and len(frame.data) > 1:
            told = (state for bits, state in _STATES_OF_THE_CONTROLLER if frame.data[1] & bits)
            self.state = next(told, self.state)

    def on_other_frame(self) -> None:
        """Take notice of a frame received from another node: a controller that hears one is on the bus."""
        if self.state in (CanState.BUS_OFF, CanState.DOWN):
            self.state = CanState.ACTIVE

    def on_opened(self) -> None:
        """Begin anew on a link just opened."""
        self.state = CanState.ACTIVE

    def on_lost(self) -> None:
        """Take notice that the link is gone."""
        self.state = CanState.DOWN

    def may_send(self, now_ns: int) -> bool:
        """Return whether a frame may go to the controller: while it is off, one a second, to see if it is back."""
        if self.state is not CanState.BUS_OFF:
            return True
        if now_ns < self._probe_ns:
            return False
        self._probe_ns = now_ns + PROBE_PAUSE_NS
        return True
