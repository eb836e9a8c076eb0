"""Whether every loop of the service still comes round: only then is the manager's watchdog fed."""

from collections.abc import Iterable


class Progress:
    """Counts the rounds of the named loops. Each loop counts its own; one thread asks."""

    def __init__(self, loops: Iterable[str]) -> None:
        self._rounds = dict.fromkeys(loops, 0)
        self._rounds_before = dict(self._rounds)

    def count_round(self, loop: str) -> None:
        """Count one round of `loop`, whether or not its device is there."""
        self._rounds[loop] += 1

    @property
    def stuck(self) -> tuple[str, ...]:
        """Return the loops that have not come round since `all_advanced`."""
        return tuple(loop for loop, rounds in self._rounds.items() if rounds == self._rounds_before[loop])

    def all_advanced(self) -> bool:
        """Return whether every loop has come round since the last time this was so."""
        if self.stuck:
            return False
        self._rounds_before = dict(self._rounds)
        return True
