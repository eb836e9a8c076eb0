"""Is this frame a new picture, taken when its stamp says? What no matcher can tell, because the pixels look sound."""

from collections.abc import Sequence

import numpy as np

from messages import FrameHeader, Image, Reason


class FrameGuard:
    """Refuses a picture that the camera repeats, and a stamp that contradicts the frame's arrival.

    Noise alone makes two pictures of a working sensor differ, so an equal one is a repeated one. A uniform picture is
    left to the matcher, which calls it by its own name.

    The way from the middle of the exposure to the arrival takes at least the readout and the transfer, always alike:
    it may take longer, when the host is busy, but a frame that seems quicker than the quickest so far has a stamp that
    jumped forward. Frames that arrive together had waited, and tell no latency. Nor do refused ones, until
    `relearn_after` of them in a row have been: then the camera's timing is another one for good, and the IMU must tell
    whether its stamps are right. What is too quick for the timing of now, but not for the one before a silence, is as
    it was then: the silence was of stamps, and no other camera. Frames that are merely late are not judged here, for
    only the clock tells that.
    """

    longest_latency_ns = 2_000_000_000
    together_ns = 10_000_000
    jump_ns = 10_000_000
    least_latencies = 20
    relearn_after = 200
    pixel_step = 8

    def __init__(self) -> None:
        self._least_latency_ns = 0
        self._before_silence_ns: int | None = None
        self._latencies = 0
        self._refused = 0
        self._arrival_ns: int | None = None
        self._previous: list[bytes] = []

    def check(self, header: FrameHeader, images: Sequence[Image]) -> Reason:
        """Return NONE, FROZEN_FRAME or TIME_INCONSISTENT for the next frame; `images` are (height, width) each."""
        repeated = self._repeats(images)
        timely = self._is_timely(header)
        if repeated:
            return Reason.FROZEN_FRAME
        return Reason.NONE if timely else Reason.TIME_INCONSISTENT

    def reset_timing(self) -> None:
        """Learn the camera's timing anew: it fell silent, and whatever comes next may be another device."""
        if self._latencies >= self.least_latencies:
            self._before_silence_ns = self._least_latency_ns
        self._latencies, self._refused = 0, 0

    @property
    def _least_ns(self) -> int:
        return max(0, self._least_latency_ns - self.jump_ns) if self._latencies >= self.least_latencies else 0

    def _repeats(self, images: Sequence[Image]) -> bool:
        sampled = [image[:: self.pixel_step, :: self.pixel_step] for image in images]
        pixels = [part.tobytes() for part in sampled]
        repeated = any(
            now == before and int(np.ptp(part)) > 0
            for now, before, part in zip(pixels, self._previous, sampled, strict=False)  # none before the first frame
        )
        self._previous = pixels
        return repeated

    def _is_timely(self, header: FrameHeader) -> bool:
        latency_ns = header.t_arrival_ns - header.t_exposure_ns
        together = self._arrival_ns is not None and header.t_arrival_ns - self._arrival_ns < self.together_ns
        self._arrival_ns = header.t_arrival_ns
        if self._before_silence_ns is not None and self._before_silence_ns <= latency_ns < self._least_ns:
            self._least_latency_ns, self._before_silence_ns = self._before_silence_ns, None
        if self._least_ns <= latency_ns <= self.longest_latency_ns:
            if not together:
                self._least_latency_ns = min(self._least_latency_ns, latency_ns) if self._latencies else latency_ns
                self._latencies += 1
            self._refused = 0
            return True
        self._refused += 1
        if self._refused >= self.relearn_after:
            self._latencies, self._refused = 0, 0
        return False
