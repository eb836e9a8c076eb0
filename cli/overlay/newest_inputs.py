"""What drawing needs of a replay's inputs: the newest frames, and the foothold that is configured."""

from daemon.config import parse_configuration
from messages import DepthFrame, Frame, Input, Reconfigured, StereoFrame
from perception.ground.foothold import FootholdSettings


class NewestInputs:
    """Keeps the frames of which nothing has been said yet, a few at most; `foothold` is the newest settings."""

    most_frames = 4

    def __init__(self, foothold: FootholdSettings) -> None:
        self.foothold = foothold
        self._frames: dict[int, Frame] = {}

    def add(self, message: Input) -> None:
        """Take one input, before the pipeline does."""
        if isinstance(message, StereoFrame | DepthFrame):
            self._frames[message.header.t_exposure_ns] = message
            while len(self._frames) > self.most_frames:
                self._frames.pop(next(iter(self._frames)))
        elif isinstance(message, Reconfigured):
            self.foothold = parse_configuration(message.configuration, "new configuration").foothold

    def take(self, t_exposure_ns: int) -> Frame | None:
        """Return the frame of that exposure, once; None where it is not kept."""
        return self._frames.pop(t_exposure_ns, None)
