"""Motion and wrench of a recording on one grid of time, as estimators take them."""

from dataclasses import dataclass

import numpy as np

from impedance.recording.recording import PlatformRecording, PlatformSettings, Poses
from impedance.recording.resampling import resampled
from messages.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class Synchronous:
    """Motion and wrench (n, 6) at `t_s` (n,), `rate_hz` apart; NaN stands where not `valid` (n,)."""

    settings: PlatformSettings
    t_s: FloatArray
    rate_hz: float
    plate: Poses
    foot: Poses | None
    wrench: FloatArray
    valid: BoolArray


def synchronous(recording: PlatformRecording) -> Synchronous:
    """Return the recording on the slower stream's grid, where both streams run; equal grids are left as they are.

    No time offset is taken out: what the stamps say is believed.
    """
    motion_rate_hz, force_rate_hz = (float((len(t) - 1) / (t[-1] - t[0])) for t in (recording.t_s, recording.force_t_s))
    slower_s = recording.t_s if motion_rate_hz <= force_rate_hz * (1.0 + 1e-6) else recording.force_t_s
    first_s = max(recording.t_s[0], recording.force_t_s[0])
    last_s = min(recording.t_s[-1], recording.force_t_s[-1])
    slack_s = 1e-3 / motion_rate_hz
    t_s = slower_s[(slower_s >= first_s - slack_s) & (slower_s <= last_s + slack_s)]
    plate = Poses.from_columns(resampled(recording.t_s, recording.plate.columns, t_s))
    foot = None if recording.foot is None else Poses.from_columns(resampled(recording.t_s, recording.foot.columns, t_s))
    wrench = resampled(recording.force_t_s, recording.wrench, t_s)
    channels = [plate.columns, wrench] if foot is None else [plate.columns, foot.columns, wrench]
    complete = np.asarray(np.isfinite(np.hstack(channels)).all(axis=1), dtype=np.bool_)
    return Synchronous(
        settings=recording.settings,
        t_s=t_s,
        rate_hz=min(motion_rate_hz, force_rate_hz),
        plate=plate,
        foot=foot,
        wrench=wrench,
        valid=complete,
    )
