"""What a receiver on CAN checks of every frame before anything in it counts: `FrameChecks`."""

from collections.abc import Hashable, Sequence

from messages.can_frames import CanMessage, can_id, profile
from messages.e2e import E2eCheck, E2eReceiver
from messages.estimates import Source
from messages.refusal import Refusal
from messages.topics import Topic

_MAX_TOLD_AGE_S = 0.254
_MIN_SPACING_CYCLES = 0.25


class FrameChecks:
    """The checks of the frames of some messages, which tell one estimate of a topic.

    `accepted` are the sources that count. Without a `max_age_s` the deadline of the topic holds; raises ValueError for
    one that a frame cannot prove.
    """

    def __init__(
        self, messages: Sequence[CanMessage], topic: Topic, max_age_s: float | None, *, accept_simulated: bool
    ) -> None:
        self.max_age_s = topic.deadline_s if max_age_s is None else max_age_s
        if not 0.0 < self.max_age_s < _MAX_TOLD_AGE_S:
            raise ValueError(
                f"max_age_s: {max_age_s} is not between 0 and {_MAX_TOLD_AGE_S} s, the oldest age a frame tells"
            )
        self.accepted = frozenset(Source) if accept_simulated else frozenset({Source.LIVE})
        self.messages = {can_id(message): message for message in messages}
        self._protection = {message: E2eReceiver(profile(message)) for message in messages}
        self._min_spacing_ns = round(1e9 * _MIN_SPACING_CYCLES * profile(messages[0]).cycle_s)
        self._heard_ns: dict[Hashable, int] = {}

    def refusal(self, message: CanMessage, data: bytes, t_ns: int) -> Refusal | None:
        """Return why the protection of a frame received at `t_ns` forbids to read it, None where it does not."""
        found = self._protection[message].check(data, t_ns)
        return None if found is E2eCheck.OK else Refusal(found.value)

    def too_soon(self, what: Hashable, t_ns: int) -> bool:
        """Return whether `what` comes once a cycle is on the heels of the last one, and note this one."""
        last_ns, self._heard_ns[what] = self._heard_ns.get(what), t_ns
        return last_ns is not None and t_ns - last_ns < self._min_spacing_ns
