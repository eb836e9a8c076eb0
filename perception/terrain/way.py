"""The camera's way over the ground, of its velocity at each frame."""

import numpy as np

from messages.arrays import FloatArray

LONGEST_GAP_S = 0.5
"""Between two frames: farther on, what lay where is not known any more."""


class Way:
    """`p_W_m` (2,) is how far the camera has come in W up to the newest frame, at `t_ns`."""

    def __init__(self) -> None:
        self.p_W_m: FloatArray = np.zeros(2)
        self.t_ns: int | None = None
        self._v_W_mps: FloatArray = np.zeros(2)

    def move(self, t_ns: int, v_W_mps: FloatArray) -> float | None:
        """Come to a frame, where the camera moves by `v_W_mps` (2,); return the seconds since the one before.

        None after a gap: the way is not known across it. At the first frame it is 0.
        """
        known, since_s, self.p_W_m = self.is_known(t_ns), self._since_s(t_ns), self.at(t_ns, v_W_mps)
        self.t_ns, self._v_W_mps = t_ns, v_W_mps
        return since_s if known else None

    def at(self, t_ns: int, v_W_mps: FloatArray) -> FloatArray:
        """Return where (2,) the camera is at a time after the newest frame, by the trapezoidal rule."""
        along: FloatArray = self.p_W_m + 0.5 * self._since_s(t_ns) * (self._v_W_mps + v_W_mps)
        return along

    def is_known(self, t_ns: int) -> bool:
        """Return whether `t_ns` is not farther from the newest frame than a gap may be."""
        return self._since_s(t_ns) <= LONGEST_GAP_S

    def _since_s(self, t_ns: int) -> float:
        return 0.0 if self.t_ns is None else 1e-9 * (t_ns - self.t_ns)
