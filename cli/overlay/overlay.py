"""A replay's frames with what was said of them drawn in, in the order in which they were seen."""

from collections.abc import Callable

from cli.overlay.drawing import drawn
from cli.overlay.picture_files import PictureFiles
from cli.overlay.said_of_frames import SaidOfFrames
from daemon.config import parse_configuration
from messages import (
    DepthFrame,
    Estimate,
    Frame,
    GroundPlane,
    Image,
    Input,
    Reconfigured,
    StereoFrame,
    Terrain,
    UnitCalibration,
)
from perception.ground.foothold import FootholdSettings
from perception.terrain.surfaces import PathSurfaces


class Overlay:
    """Takes a pipeline's inputs and estimates as they come, and writes one picture for each frame with a ground.

    `surfaces` returns what the pipeline's newest terrain was made of; `shown` makes of a frame's image what is
    drawn on, or None where that frame is to be passed over.
    """

    def __init__(
        self,
        calibration: UnitCalibration,
        foothold: FootholdSettings,
        files: PictureFiles,
        surfaces: Callable[[], PathSurfaces],
        shown: Callable[[Image], Image | None] = lambda image: image,
    ) -> None:
        self._said = SaidOfFrames(calibration)
        self._foothold = foothold
        self._files = files
        self._surfaces = surfaces
        self._shown = shown
        self._frames: dict[int, Frame] = {}
        self._frame: Frame | None = None

    def add_input(self, message: Input) -> None:
        """Take one input, before the pipeline does."""
        if isinstance(message, StereoFrame | DepthFrame):
            self._frames[message.header.t_exposure_ns] = message
            while len(self._frames) > _MOST_FRAMES:
                self._frames.pop(next(iter(self._frames)))
        elif isinstance(message, Reconfigured):
            self._foothold = parse_configuration(message.configuration, "new configuration").foothold

    def add_estimate(self, estimate: Estimate) -> None:
        """Take one estimate; the picture is written once all is said of its frame."""
        if isinstance(estimate, GroundPlane):
            self._finish()
            self._frame = self._frames.pop(estimate.t_exposure_ns, None)
        self._said.add(estimate)
        if isinstance(estimate, Terrain):
            self._said.add_surfaces(estimate.t_exposure_ns, self._surfaces())

    def close(self) -> None:
        """Write the last picture."""
        self._finish()

    def _finish(self) -> None:
        frame, self._frame = self._frame, None
        said = None if frame is None else self._said.about(frame.header.t_exposure_ns)
        image = None if frame is None or said is None else self._shown(frame.images[0])
        if said is not None and image is not None:
            self._files.write(drawn(image, said, self._foothold))


_MOST_FRAMES = 4
