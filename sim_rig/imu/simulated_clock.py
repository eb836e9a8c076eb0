"""A clock for what runs faster than real time."""


class SimulatedClock:
    """Nanoseconds that pass only in `sleep` and `advance_to`."""

    def __init__(self, now_ns: int) -> None:
        self._now_ns = now_ns

    def __call__(self) -> int:
        """Return the time."""
        return self._now_ns

    def sleep(self, seconds: float) -> None:
        """Let time pass; never backwards."""
        self._now_ns += round(max(0.0, seconds) * 1e9)

    def advance_to(self, t_ns: int) -> None:
        """Let time pass until `t_ns`, if that is not over yet."""
        self._now_ns = max(self._now_ns, t_ns)
