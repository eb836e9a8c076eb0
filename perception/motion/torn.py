"""Is part of a picture still of the one before? Its corners then move as the picture did one step earlier.

Where a transfer is cut short, the rows from some line on are those of an older picture, in both eyes. Each part is
sound in itself: it shows a plane, but that of another instant, turned by what the camera has turned since. Of the
corners that do not share a step's motion, those of such rows share that of the step before it, since the pictures that
they are followed between are the two before. What moves by itself, a lamp that is mirrored or a person, does neither.
"""

import numpy as np

from messages.arrays import BoolArray, FloatArray


class Torn:
    """Follows which share of the corners is a step late; `contradicts` while that is more than chance."""

    frames = 4.0  # about so many count
    most_share = 0.06  # walks over all kinds of ground, among people, leave 0.02 at most; torn ones 0.07 to 0.3
    far_px = 1.0  # from this step's motion, and
    nearer = 3.0  # so many times nearer to the last one's

    def __init__(self) -> None:
        self._share = 0.0

    @property
    def contradicts(self) -> bool:
        """Return whether pictures are of two instants."""
        return self._share > self.most_share

    def add(self, off_px: FloatArray, off_before_px: FloatArray) -> None:
        """Take how far (N,) corners are from where this step's motion and where the last one's would have them."""
        self._share += (float(np.mean(self._late(off_px, off_before_px))) - self._share) / self.frames

    def _late(self, off_px: FloatArray, off_before_px: FloatArray) -> BoolArray:
        late: BoolArray = (off_px > self.far_px) & (self.nearer * off_before_px < off_px)
        return late
