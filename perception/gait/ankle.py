"""What the ankle says of its own foot: when it lands. That takes precedence over what the hip shows."""

from messages import AnkleState, GaitPhase


class AnkleContacts:
    """Finds the contacts of the prosthetic foot in the ankle's states.

    The foot stands where the ankle's phase says so; where the phase is not known, once it bears `bears_n`, until it
    bears less than half of that.
    """

    bears_n = 60.0
    longest_gap_ns = 100_000_000

    def __init__(self) -> None:
        self._stands: bool | None = None
        self._newest_ns = 0
        self._landed_ns: list[int] = []

    def add(self, state: AnkleState) -> None:
        """Take the next state; after a gap the first one only says where the foot is."""
        stands = self._stands_in(state)
        gap = not 0 <= state.t_sample_ns - self._newest_ns <= self.longest_gap_ns
        if stands and self._stands is False and not gap:
            self._landed_ns = [*self._landed_ns[-_MOST_LANDINGS:], state.t_sample_ns]
        self._stands, self._newest_ns = stands, state.t_sample_ns

    def take(self) -> list[int]:
        """Return the contacts (ns) since this was last asked, in their order."""
        landed_ns, self._landed_ns = self._landed_ns, []
        return landed_ns

    def _stands_in(self, state: AnkleState) -> bool:
        if state.phase is not GaitPhase.UNKNOWN:
            return state.phase is GaitPhase.STANCE
        return state.load_n > (0.5 * self.bears_n if self._stands else self.bears_n)


_MOST_LANDINGS = 3
