"""The line that is kept up to date while a service runs: at a terminal, for the service manager, or once a second."""

from __future__ import annotations

import time
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np
from rich.live import Live
from rich.text import Text

from cli.console import console
from daemon.sd_notify import ServiceManager
from daemon.summary import Tally
from messages import GroundPlane, Motion, Status

if TYPE_CHECKING:
    from lab.evaluation.truth_observer import TruthObserver  # a wearable has no rig


class LiveStatus:
    """Shows the newest estimates of ground and motion, the ground beside the truth where there is one."""

    def __init__(
        self, tally: Tally, observer: TruthObserver | None = None, manager: ServiceManager | None = None
    ) -> None:
        self._manager = manager
        self._tally = tally
        self._observer = observer
        self._start_s = time.monotonic()
        self._told_s = 0.0
        self._live = Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else None

    def __enter__(self) -> LiveStatus:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _traceback: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def refresh(self, problems: Sequence[str] = ()) -> None:
        """Show the state as it is now, and what is wrong with devices."""
        elapsed_s = time.monotonic() - self._start_s
        seen = "; ".join((self._seen(), *problems))
        line = f"{elapsed_s:6.1f} s  " + seen
        if self._live is not None:
            self._live.update(Text(line), refresh=True)
        elif elapsed_s - self._told_s >= 1.0:
            self._told_s = elapsed_s
            if self._manager is not None and self._manager.is_there:
                self._manager.status(seen)
            else:
                console.print(line, soft_wrap=True)

    def _seen(self) -> str:
        ground = self._tally.ground
        if ground is None:
            return "waiting for the first frame"
        if ground.status is not Status.VALID:
            return f"{ground.status.value}: {ground.reason.value}"
        return _numbers(ground) + _walked(self._tally.motion) + self._true()

    def _true(self) -> str:
        truth = self._observer.truth if self._observer is not None else None
        if truth is None:
            return ""
        kind = ("standing on " if truth.standing else "") + truth.kind + (", at an edge" if truth.transition else "")
        return f"   truth {np.degrees(truth.slope_sagittal_rad):+5.1f}°  {truth.height_m:.3f} m  {kind}"


def _walked(motion: Motion | None) -> str:
    if motion is None or motion.status is not Status.VALID:
        return ""
    speed_mps = np.hypot(motion.velocity_H_mps[0], motion.velocity_H_mps[1])
    rides = "  on a ground that moves" if motion.ground_moves else ""
    return f"  {speed_mps:.1f} m/s  {motion.distance_m:.1f} m walked{rides}"


def _numbers(ground: GroundPlane) -> str:
    slope_std_deg, height_std_mm = np.degrees(np.sqrt(ground.covariance[0])), 1e3 * np.sqrt(ground.covariance[5])
    return (
        f"slope {np.degrees(ground.slope_sagittal_rad):+5.1f} ± {slope_std_deg:.1f}°  "
        f"frontal {np.degrees(ground.slope_frontal_rad):+5.1f}°  "
        f"height {ground.height_m:.3f} ± {1e-3 * height_std_mm:.3f} m"
    )
