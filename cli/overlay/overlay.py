"""A replay's frames with what was said of them drawn in, in the order in which they were seen."""

from collections.abc import Callable

from cli.overlay.drawing import drawn
from cli.overlay.newest_inputs import NewestInputs
from cli.overlay.picture_files import PictureFiles
from cli.overlay.said_of_frames import SaidOfFrames
from messages import (
    Estimate,
    Frame,
    GroundPlane,
    Image,
    Input,
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
        self._inputs = NewestInputs(foothold)
        self._files = files
        self._surfaces = surfaces
        self._shown = shown
        self._frame: Frame | None = None

    def add_input(self, message: Input) -> None:
        """Take one input, before the pipeline does."""
        self._inputs.add(message)

    def add_estimate(self, estimate: Estimate) -> None:
        """Take one estimate; the picture is written once all is said of its frame."""
        if isinstance(estimate, GroundPlane):
            self._finish()
            self._frame = self._inputs.take(estimate.t_exposure_ns)
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
            self._files.write(drawn(image, said, self._inputs.foothold))
