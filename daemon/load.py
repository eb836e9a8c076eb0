"""How much work the pipeline may do on each frame: by the frames that it had no time for, and by its processor time."""

from messages import Load

RELAX_AFTER_S = 5.0
MOST_BUSY = 0.6
"""Share of one core beyond which the pipeline leaves too little for the sensors and for what is published."""
FEW_BUSY = 0.4
"""Share with reduced work below which all of it would stay below `MOST_BUSY`: reduced frames cost about two thirds."""


class LoadDecision:
    """REDUCED once two frames were superseded, or the pipeline was busier than `MOST_BUSY`, within a second; NORMAL
    again after `RELAX_AFTER_S` in which no frame was and it was never busier than `FEW_BUSY`."""

    def __init__(self, now_ns: int) -> None:
        """Begin at `now_ns`, with no frame superseded and no processor time used."""
        self._superseded = self._busy_ns = 0
        self._decided_ns = self._calm_since_ns = now_ns
        self._load = Load.NORMAL

    def decide(self, superseded: int, busy_ns: int, now_ns: int) -> Load | None:
        """Return the new load level if it changes; called once a second, with how many frames were superseded and how
        much processor time the pipeline has used since the start."""
        lost, self._superseded = superseded - self._superseded, superseded
        busy = (busy_ns - self._busy_ns) / max(1, now_ns - self._decided_ns)
        self._busy_ns, self._decided_ns = busy_ns, now_ns
        if lost or busy > FEW_BUSY:
            self._calm_since_ns = now_ns
        calm_s = (now_ns - self._calm_since_ns) * 1e-9
        if self._load is Load.NORMAL and (lost >= _MOST_LOST or busy > MOST_BUSY):
            self._load = Load.REDUCED
        elif self._load is Load.REDUCED and calm_s > RELAX_AFTER_S:
            self._load = Load.NORMAL
        else:
            return None
        return self._load


_MOST_LOST = 2
