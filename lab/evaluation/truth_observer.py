"""Compares each ground estimate of a running service with the truth of its frame."""

from daemon.recorder import Recorder
from lab.evaluation.score import Scoreboard
from messages import Estimate, FrameHeader, GroundPlane, GroundTruth
from sim_rig.wearer import SimulatedWearer


class TruthObserver:
    """Observer of the service; the truth goes to the scoreboard and, if there is one, to the recorder."""

    def __init__(self, wearer: SimulatedWearer, recorder: Recorder | None = None) -> None:
        self._wearer = wearer
        self._recorder = recorder
        self.scoreboard = Scoreboard()
        self.truth: GroundTruth | None = None

    def __call__(self, estimate: Estimate, header: FrameHeader | None) -> None:
        """Score one ground estimate that stems from a frame."""
        if not isinstance(estimate, GroundPlane) or header is None:
            return
        self.truth = self._wearer.truth_of(estimate)
        self.scoreboard.add(estimate, self.truth)
        if self._recorder is not None:
            self._recorder.offer(self.truth)
