"""When the rig's camera exposes each frame, and what the frame's header says about it."""

import numpy as np

from drivers.camera.frame_grid import GRID_NS
from messages import DepthCalibration, FrameHeader, StereoCalibration

_LATENCY_S = (0.030, 0.045)
_MEAN_EXPOSURE_S, _EXPOSURE_SWING_S, _EXPOSURE_PERIOD_S = 0.006, 0.002, 17.0


class Shutter:
    """Frame k of one walk is truly at mid-exposure at start + k · 50 ms.

    The device stamps it as its maker's clock does, the true offset before mid-exposure; the header holds that stamp
    plus the calibrated offset, so that the calibration's time residual is in every header. `true` is the camera as it
    is, `stated` as its calibration says.
    """

    def __init__(
        self,
        true: StereoCalibration | DepthCalibration,
        stated: StereoCalibration | DepthCalibration,
        seed: int,
        start_ns: int,
    ) -> None:
        offset_error_s = stated.stamp_to_mid_exposure_s - true.stamp_to_mid_exposure_s
        self._stamp_error_ns = round(offset_error_s * 1e9)
        self._stamp_to_true_ns = round(true.stamp_to_mid_exposure_s * 1e9)
        self._lens = true.lens
        self._seed = seed
        self._start_ns = start_ns

    def true_ns(self, k: int) -> int:
        """Return the true mid-exposure of frame `k`."""
        return self._start_ns + k * GRID_NS

    def stamp_ns(self, k: int) -> int:
        """Return what the device stamps on frame `k`."""
        return self.true_ns(k) - self._stamp_to_true_ns

    def true_of(self, t_exposure_ns: int) -> int:
        """Return the true instant of what a header calls `t_exposure_ns`."""
        return t_exposure_ns - self._stamp_error_ns

    def first_in_time(self, t_ns: int) -> int:
        """Return the first frame that is surely not due before `t_ns`."""
        shortest_ns = round(_LATENCY_S[0] * 1e9)
        return max(0, -((self._start_ns + shortest_ns - t_ns) // GRID_NS))

    def frame_at(self, t_ns: int) -> int:
        """Return the frame whose true mid-exposure is nearest to `t_ns`."""
        return round((t_ns - self._start_ns) / GRID_NS)

    def exposure_s(self, k: int) -> float:
        """Return the exposure time of frame `k`: 4 to 8 ms, as automatic exposure drifts."""
        return _MEAN_EXPOSURE_S + _EXPOSURE_SWING_S * float(np.sin(2 * np.pi * k * GRID_NS * 1e-9 / _EXPOSURE_PERIOD_S))

    def due_ns(self, k: int) -> int:
        """Return when frame `k` reaches the host: 30 to 45 ms after its mid-exposure."""
        latency_s = np.random.default_rng([self._seed, 5, k]).uniform(*_LATENCY_S)
        return self.true_ns(k) + round(latency_s * 1e9)

    def header(self, k: int) -> FrameHeader:
        """Return the header of frame `k`."""
        return FrameHeader(
            seq=k,
            t_exposure_ns=self.true_ns(k) + self._stamp_error_ns,
            t_arrival_ns=self.due_ns(k),
            exposure_s=self.exposure_s(k),
            width_px=self._lens.width_px,
            height_px=self._lens.height_px,
        )
