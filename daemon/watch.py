"""What a person should know of the running service, logged once and not with every frame."""

import logging
import math
import time
from collections.abc import Callable, Mapping

from drivers.protocols import DeviceError
from messages import Reason

log = logging.getLogger("gaiteyes")

FRAMES_BEFORE_LOGGED = 20
QUIET_S = 10.0

IN_WORDS = {
    Reason.NOT_AT_REST: "the IMU is not at rest yet; stand still for a second",
    Reason.NO_IMU: "no IMU samples for the frames",
    Reason.NO_FRAME: "no frames from the camera",
    Reason.LOW_TEXTURE: "too few pixels of the foothold could be matched, or its tiles are all alike",
    Reason.NOT_PLANAR: "no plane explains the foothold",
    Reason.TOO_STEEP: "the foothold is steeper than 40°",
    Reason.FOOTHOLD_OUT_OF_VIEW: "the foothold is outside the picture; check how the camera is mounted",
    Reason.OUT_OF_RANGE: "the ground is nearer than the search can match",
    Reason.EYES_SWAPPED: "left and right are exchanged: the pair matches only the other way round",
    Reason.WRONG_SIZE: "the frames are of another size than the calibration",
    Reason.FROZEN_FRAME: "the camera repeats one picture",
    Reason.TIME_INCONSISTENT: "stamps contradict arrival or IMU, or part of a picture is of another instant",
    Reason.LATE: "the planes come too late; the processor is overloaded, or the process stood still",
    Reason.IMU_INCONSISTENT: "the IMU measures another motion than the camera sees; check how both are mounted",
    Reason.EYES_MISALIGNED: "one eye is turned, or sees all higher or larger, than calibrated; calibrate the pair",
    Reason.CAMERA_SLIPPED: "the camera has turned on its mount; fasten it and calibrate it to the IMU again",
    Reason.DISTANCES_WRONG: "what is seen moves as at another distance; clean the window, or calibrate the pair again",
    Reason.OCCLUDED: "the ground on which the foot will land is hidden behind an edge",
    Reason.UNCONFIRMED: "the camera has been out of order: the gyroscope is checked again once it sees the ground move",
    Reason.OVER_EXPOSED: "the foothold is white or black in the picture: too bright or too dark to be seen",
    Reason.VIEW_DEFORMED: "part of one eye's picture is moved, as by a drop or a bent window; clean or replace it",
}


SETPOINT_IN_WORDS = {
    Reason.PHASE_CONTRADICTS: "the ankle's own phase does not fit the steps that are seen; check [foothold] side, and"
    " what the ankle sends",
}
"""What goes on for a second only by mistake; the other reasons come and go with the way."""


class Outage:
    """Logs the beginning and the end of a device's absence, not every attempt in between.

    A device that comes and goes is logged once in `QUIET_S`; what happened meanwhile is counted.
    """

    def __init__(self, device: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._device = device
        self._clock = clock
        self._attempts = 0
        self._began_s = 0.0
        self._logged_s = -math.inf
        self._logging = False
        self._unlogged = 0
        self.problem = ""
        """What is wrong with the device now, empty if nothing is."""

    def add_failure(self, error: DeviceError) -> None:
        """Take one failed attempt."""
        self.problem = f"{self._device} lost: {error}"
        if self._attempts == 0:
            self._began_s = self._clock()
            self._logging = self._began_s - self._logged_s >= QUIET_S
            if self._logging:
                log.error("%s%s", self.problem, f" outages_not_logged={self._unlogged}" if self._unlogged else "")
                self._logged_s, self._unlogged = self._began_s, 0
            else:
                self._unlogged += 1
        self._attempts += 1

    def add_success(self) -> None:
        """Take one success."""
        if self._attempts and self._logging:
            outage_s = self._clock() - self._began_s
            log.warning("%s is back: outage_s=%.2f attempts=%d", self._device, outage_s, self._attempts)
        self._attempts, self.problem = 0, ""


class ReasonWatch:
    """Logs why there is no `what`, in these `words`, once that has lasted a second, and when it ends.

    Of the ground STARTING is not logged: it is soon over, or turns into another reason.
    """

    def __init__(
        self,
        what: str = "ground",
        words: Mapping[Reason, str] = IN_WORDS,
        again: str = "the ground is seen again",
    ) -> None:
        self._what, self._words, self._again = what, words, again
        self._reason = Reason.NONE
        self._frames = 0
        self._logged = False

    def add_reason(self, reason: Reason) -> None:
        """Take the reason of the next estimate."""
        if reason is not self._reason:
            if reason is Reason.NONE and self._logged:
                log.warning("%s", self._again)
            self._reason, self._frames = reason, 0
            self._logged = self._logged and reason is not Reason.NONE
        self._frames += 1
        if reason in self._words and self._frames == FRAMES_BEFORE_LOGGED:
            log.warning("no %s: %s", self._what, self._words[reason])
            self._logged = True
