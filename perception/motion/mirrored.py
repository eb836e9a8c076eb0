"""By how much the errors of corners are correlated where the ground mirrors what is above it.

A polished floor shows itself and, as far below it, the lamps above. The two move differently in the picture, and a
window that holds an edge of each is found at neither: across the lamp's edge it follows the lamp, along it the floor.
Such corners pull the motion that most share towards the lamps', all of them to the same side. A common error shows in
no residual; but many corners near that motion do not agree with it, a share s of those within some pixels, and those
that do scatter by σ. From the means of both over the last frames the common error is estimated as

    c = g max(s − s₀, 0) σ                                                                                        (1)

of a ray's tangent, where s₀ is the share that other bodies, and noise that is not normal, leave at most. On a floor
that mirrors nothing c is 0.
"""


class Mirrored:
    """Follows s and σ of (1), step after step."""

    frames = 4.0  # about so many count
    usual_share = 0.1
    gain = 20.0  # on floors under lamps no ground is wrong and valid with 12 to 25

    def __init__(self) -> None:
        self._share = self._noise = 0.0

    @property
    def common_error(self) -> float:
        """Return c of (1)."""
        return self.gain * max(self._share - self.usual_share, 0.0) * self._noise

    def add(self, disagreeing: float, noise: float) -> None:
        """Take the share of the corners near a step's motion that do not agree with it and the deviation of those that
        do, as tangents."""
        self._share += (disagreeing - self._share) / self.frames
        self._noise += (noise - self._noise) / self.frames
