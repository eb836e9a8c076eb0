"""A polished floor: it shows, beside itself, the ceiling above it, as far below it as that is high."""

from dataclasses import dataclass

from messages.arrays import FloatArray


@dataclass(frozen=True)
class Polish:
    """Of a level floor, `share` of the light that falls on it squarely is mirrored, more at flat angles.

    The ceiling, `ceiling_m` above, has lamps of `lamp_grey` grey levels: several times as bright as the floor below.
    """

    share: float = 0.08
    ceiling_m: float = 2.7
    lamp_grey: float = 900.0

    def mirrored(self, cosine: FloatArray) -> FloatArray:
        """Return the share (…,) mirrored of light that meets the floor at this cosine to its normal (Schlick 1994)."""
        shares: FloatArray = self.share + (1.0 - self.share) * (1.0 - cosine) ** 5
        return shares
