"""Which of a camera's frames are used: those nearest the points of a 50 ms grid."""

import statistics
from collections import deque

from messages import TOPICS

GRID_NS = TOPICS["frame"].period_ns
"""20 frames a second, the rate the daemon works at."""


class GridPicker:
    """Chooses, by timestamp, the frame nearest each point of a 50 ms grid, without waiting for the one after it.

    A frame is taken when it is as near to the next grid point as the frame expected one camera period later, that is
    from half a period before the point on. The period is the median of the latest intervals, so a camera that slows
    down in poor light needs no word from the driver. What comes from a camera of

    - 60 or 20 fps: every third or every frame, 50 ms apart;
    - 30 fps: 20 frames a second, alternately 33 and 67 ms apart;
    - 15 fps, or any rate below 20: every frame, hence fewer than 20 a second.

    The first frame sets the grid's phase. From then on the phase follows the frames with `_PHASE_GAIN`: a camera
    whose clock differs by up to 1 % from the host's is locked to, where a fixed grid would drift until each point
    lay midway between two frames and the jitter of their stamps chose among them.

    A grid point is served once or, when no frame came within 25 ms of it, not at all; times never run backwards.
    """

    _PHASE_GAIN = 0.1
    _INTERVALS = 9

    def __init__(self, frame_period_s: float, spacing_ns: int = GRID_NS) -> None:
        self._spacing_ns = spacing_ns
        self._intervals_ns = deque([round(frame_period_s * 1e9)], maxlen=self._INTERVALS)
        self._latest_ns: int | None = None
        self._next_point_ns = 0

    def pick(self, t_ns: int) -> bool:
        """Return whether the frame stamped `t_ns` is the one to use; call once for every sound frame, in order."""
        if self._latest_ns is None:
            self._latest_ns = t_ns
            self._next_point_ns = t_ns + self._spacing_ns
            return True
        if t_ns <= self._latest_ns:
            return False
        self._intervals_ns.append(t_ns - self._latest_ns)
        self._latest_ns = t_ns

        half_cell_ns = self._spacing_ns // 2
        half_period_ns = min(round(statistics.median(self._intervals_ns)) // 2, half_cell_ns)
        passed = max(0, (t_ns - self._next_point_ns + half_cell_ns) // self._spacing_ns)
        self._next_point_ns += passed * self._spacing_ns
        late_ns = t_ns - self._next_point_ns
        if late_ns < -half_period_ns:
            return False
        # A frame later than half a period stands in for a lost one and says nothing about the phase.
        drift_ns = round(self._PHASE_GAIN * late_ns) if late_ns <= half_period_ns else 0
        self._next_point_ns += self._spacing_ns + drift_ns
        return True
