"""The attitudes that a pipeline told, at any instant of the last second."""

import numpy as np

from messages import Attitude, Status
from perception.attitude.history import AttitudeAt, AttitudeHistory, OutsideHistoryError


class ToldAttitudes:
    """Takes what was published, sample by sample."""

    def __init__(self) -> None:
        self._history = AttitudeHistory()

    def add(self, told: Attitude) -> None:
        """Take one attitude; an invalid one ends what was before it."""
        if told.status is not Status.VALID:
            self._history.clear()
            return
        self._history.append(AttitudeAt(told.t_sample_ns, told.q_WB, told.w_WB_B_radps, 0.0, np.zeros((3, 3))))

    def at(self, t_ns: int) -> AttitudeAt | None:
        """Return the attitude at `t_ns`, or None where none is known."""
        try:
            return self._history.at(t_ns)
        except OutsideHistoryError:
            return None
