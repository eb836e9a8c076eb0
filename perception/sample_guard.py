"""Does the IMU still measure? What no filter can tell, because a sample that never changes looks like perfect rest."""

from messages import ImuSample


class SampleGuard:
    """Refuses samples that repeat: noise alone makes two samples of a working chip differ on one of its six axes.

    A chip that is read a little faster than it measures gives a sample twice; `most_alike` in a row are none.
    """

    most_alike = 4

    def __init__(self) -> None:
        self._last: tuple[float, ...] | None = None
        self._alike = 0

    def check(self, sample: ImuSample) -> bool:
        """Return whether `sample` may be used."""
        values = (*sample.sf_B_mps2, *sample.w_WB_B_radps)
        self._alike = self._alike + 1 if values == self._last else 0
        self._last = values
        return self._alike < self.most_alike
