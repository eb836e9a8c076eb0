"""The calibrated samples of the last seconds, which the filter takes again when a step of the camera arrives late."""

from collections import deque
from collections.abc import Iterator
from itertools import pairwise

from perception.attitude.state import Sample
from perception.vec3 import between


class PastSamples:
    """The newest `_MOST` samples, in the order of time."""

    def __init__(self) -> None:
        self._samples: deque[Sample] = deque(maxlen=_MOST)

    def append(self, sample: Sample) -> None:
        """Take a sample later than all others."""
        self._samples.append(sample)

    def reaches(self, t_ns: int) -> bool:
        """Return whether all samples after `t_ns` are here."""
        return self._samples[0].t_ns <= t_ns

    def from_to(self, from_ns: int | None, until_ns: int) -> Iterator[Sample]:
        """Yield what was measured after `from_ns` up to `until_ns`: the last one may lie on the line between two."""
        samples = self._samples
        first = len(samples) - 1
        while from_ns is not None and first > 0 and samples[first].t_ns > from_ns:
            first -= 1
        for before, after in pairwise([samples[index] for index in range(first, len(samples))]):
            if before.t_ns >= until_ns:
                break
            yield _between(before, after, until_ns)

    def unbroken_since(self, t_ns: int, longest_gap_ns: int) -> list[Sample]:
        """Return all samples after `t_ns`; none where one is clipped, or is missing for longer than the gap."""
        if not self.reaches(t_ns):
            return []
        since = [sample for sample in self._samples if sample.t_ns > t_ns]
        times_ns = [t_ns, *(sample.t_ns for sample in since)]
        broken = any(after - before > longest_gap_ns for before, after in pairwise(times_ns))
        return [] if broken or any(sample.clipped for sample in since) else since


def _between(before: Sample, after: Sample, until_ns: int) -> Sample:
    """Return `after`, or what lies on the line to it at `until_ns` where that is earlier."""
    if after.t_ns <= until_ns:
        return after
    share = (until_ns - before.t_ns) / (after.t_ns - before.t_ns)
    sf_B, w_B = between(before.sf_B, after.sf_B, share), between(before.w_B, after.w_B, share)
    return Sample(until_ns, sf_B, w_B, before.clipped or after.clipped, before.temperature_degC)


_MOST = 1024
