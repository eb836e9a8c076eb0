"""By how much the errors of corners are correlated where the ground mirrors what is above it.

A polished floor shows itself and, as far below it, the lamps above. The two move differently in the picture, and a
window that holds an edge of each is found at neither: across the lamp's edge it follows the lamp, along it the floor.
Such corners pull the motion that most share towards the lamps', all of them to the same side. A common error shows in
no residual; but many corners near that motion do not agree with it, a share s of those within some pixels, and those
that do scatter by σ. From the means of both over the last frames the common error is estimated as

    c = g max(s − s₀, 0) σ                                                                                        (1)

of a ray's tangent, where s₀ is the share that other bodies, and noise that is not normal, leave at most. On a floor
that mirrors nothing c is 0.

Corners also disagree where part of the picture is of another instant, torn; such errors must be told and not allowed
for, and c is 0 again. All corners below some row disagree then and none above it, or the reverse: at the row that
divides them most,

    r = max |s(above) − s(below)|                                                                                 (2)

is 0.3 to 0.5 where lamps are mirrored, and 0.8 to 0.95 in torn pictures while the camera shakes. While it does not few
corners disagree, so r is averaged with the weight s, over more frames.
"""

from typing import NamedTuple

import numpy as np

from messages.arrays import BoolArray, FloatArray

LEAST_CORNERS = 10


class Disagreement(NamedTuple):
    """s of (1) and r of (2) of one step."""

    share: float
    by_rows: float


def disagreement(agrees: BoolArray, rows: FloatArray) -> Disagreement:
    """Return what share of the corners near a motion does not agree with it, and how the rows divide them.

    `agrees` and `rows`, in any unit, are (N,). Fewer than `LEAST_CORNERS` tell no division.
    """
    count = len(rows)
    if count < LEAST_CORNERS:
        return Disagreement(float(np.count_nonzero(~agrees)) / max(count, 1), 0.0)
    least = round(_LEAST_PART * count)
    splits = np.arange(least, count - least + 1)
    above = np.concatenate(([0], np.cumsum(~agrees[np.argsort(rows)])))
    contrast = above[splits] / splits - (above[-1] - above[splits]) / (count - splits)
    return Disagreement(float(above[-1]) / count, float(np.abs(contrast).max()))


class Mirrored:
    """Follows s and σ of (1) and r of (2), step after step."""

    frames = 4.0  # about so many count,
    frames_by_rows = 10.0  # and for r
    usual_share = 0.1
    gain = 20.0  # on floors under lamps no ground is wrong and valid with 12 to 25
    most_by_rows = 0.55  # lamps 0.51 at most, torn pictures 0.56 at least

    def __init__(self) -> None:
        self._share = self._noise = self._weight = self._by_rows = 0.0

    @property
    def common_error(self) -> float:
        """Return c of (1)."""
        if self._by_rows > self.most_by_rows * self._weight:
            return 0.0
        return self.gain * max(self._share - self.usual_share, 0.0) * self._noise

    def add(self, disagreeing: Disagreement, noise: float) -> None:
        """Take what of the corners near a step's motion does not agree with it, and the deviation of those that do, a
        tangent."""
        self._share += (disagreeing.share - self._share) / self.frames
        self._noise += (noise - self._noise) / self.frames
        self._weight += (disagreeing.share - self._weight) / self.frames_by_rows
        self._by_rows += (disagreeing.share * disagreeing.by_rows - self._by_rows) / self.frames_by_rows


_LEAST_PART = 0.2
"""Of the corners on either side of a split: one corner of five alone would divide them by chance."""
