"""How much work the pipeline may do on each frame, decided from the frames that it had no time for."""

from messages import Load

RELAX_AFTER_S = 5.0


class LoadDecision:
    """REDUCED once two frames were superseded within a second; NORMAL again after `RELAX_AFTER_S` without any."""

    def __init__(self) -> None:
        self._superseded = 0
        self._load = Load.NORMAL
        self._calm_since_ns = 0

    def decide(self, superseded: int, now_ns: int) -> Load | None:
        """Return the new load level if it changes; called once a second."""
        lost, self._superseded = superseded - self._superseded, superseded
        if lost:
            self._calm_since_ns = now_ns
        calm_s = (now_ns - self._calm_since_ns) * 1e-9
        if self._load is Load.NORMAL and lost >= 2:
            self._load = Load.REDUCED
        elif self._load is Load.REDUCED and calm_s > RELAX_AFTER_S:
            self._load = Load.NORMAL
        else:
            return None
        return self._load
