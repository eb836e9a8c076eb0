"""A replay as an MCAP file for Foxglove's own panels: picture, calibration, transforms, scene, and all estimates."""

from collections.abc import Callable
from pathlib import Path

from foxglove import Channel, Context, open_mcap
from foxglove.messages import CameraCalibration, CompressedImage, FrameTransform, SceneUpdate

from cli.overlay.newest_inputs import NewestInputs
from cli.overlay.said_of_frames import SaidOfFrames
from cli.overlay.shapes import shapes
from cli.scene import conversion
from daemon.recording_file import viewer_schema
from daemon.replay_source import ReplaySource
from messages import (
    TOPICS,
    Estimate,
    Frame,
    GroundPlane,
    Input,
    Terrain,
    UserError,
    capture_ns,
)
from messages.codec import encode
from perception.terrain.surfaces import PathSurfaces

PICTURE, CALIBRATION, SCENE, TRANSFORMS = "/camera/image", "/camera/calibration", "/scene", "/tf"
LAYOUT = Path(__file__).parent / "layout.json"
"""For Foxglove's "Import from file": picture with the scene drawn in, the scene in space, slope, height, health."""


class FoxgloveFile:
    """Writes `path` while a replay of `source` goes on; a file that is there is overwritten.

    `surfaces` returns what the pipeline's newest terrain was made of. All times are UTC where the source tells its
    offset, else since the unit's start. Raises UserError, in one line, where `path` cannot be written.
    """

    def __init__(self, path: Path, source: ReplaySource, surfaces: Callable[[], PathSurfaces]) -> None:
        if path.suffix != ".mcap":
            raise UserError(f"--foxglove {path}: the name must end in .mcap")
        self._calibration = source.calibration
        self._eye = conversion.camera_of(source.calibration)
        self._inputs = NewestInputs(source.configuration.foothold)
        self._offset_ns = source.utc_offset_ns or 0
        self._surfaces = surfaces
        self._said = SaidOfFrames(source.calibration)
        self._now_ns = 0
        context = self._context = Context()  # kept, because its end closes its channels
        try:
            self._writer = open_mcap(path, context=context, allow_overwrite=True)
        except OSError as error:
            raise UserError(f"--foxglove {path}: {error.strerror or error}") from error
        self._estimates = {
            topic.message: Channel(
                f"/{topic.name}", message_encoding="json", schema=viewer_schema(topic.message), context=context
            )
            for topic in TOPICS.values()
            if topic.published
        }
        schemas = {
            PICTURE: CompressedImage.get_schema(),
            CALIBRATION: CameraCalibration.get_schema(),
            SCENE: SceneUpdate.get_schema(),
            TRANSFORMS: FrameTransform.get_schema(),
        }
        self._channels = {
            name: Channel(name, message_encoding="protobuf", schema=schema, context=context)
            for name, schema in schemas.items()
        }

    def add_input(self, message: Input) -> None:
        """Take one input, before the pipeline does."""
        self._inputs.add(message)

    def add_estimate(self, estimate: Estimate) -> None:
        """Take one estimate; the frame's picture, transforms and scene are written after its last."""
        self._now_ns = max(self._now_ns, capture_ns(estimate))
        self._estimates[type(estimate)].log(encode(estimate), log_time=self._log_ns)
        self._said.add(estimate)
        frame = self._inputs.take(estimate.t_exposure_ns) if isinstance(estimate, GroundPlane) else None
        if frame is not None:
            self._write_picture(frame)
        elif isinstance(estimate, Terrain):
            self._said.add_surfaces(estimate.t_exposure_ns, self._surfaces())
            self._write_scene(estimate.t_exposure_ns)

    def close(self) -> None:
        """Write the index and close the file."""
        self._writer.close()

    @property
    def _log_ns(self) -> int:
        return max(self._now_ns + self._offset_ns, 0)

    def _write_picture(self, frame: Frame) -> None:
        t_ns = frame.header.t_exposure_ns + self._offset_ns
        lens = self._calibration.camera.lens
        image = conversion.straightened(frame.images[0], lens)
        self._log(PICTURE, conversion.picture(image, self._eye, t_ns).encode())
        self._log(CALIBRATION, conversion.camera_calibration(lens, self._eye, t_ns).encode())

    def _write_scene(self, t_exposure_ns: int) -> None:
        said, t_ns = self._said.about(t_exposure_ns), t_exposure_ns + self._offset_ns
        if said is None or said.sight is None:
            return
        for each in conversion.transforms(self._calibration, said.sight.R_WE, said.sight.R_EH, t_ns):
            self._log(TRANSFORMS, each.encode())
        self._log(SCENE, conversion.scene(shapes(said, self._inputs.foothold), t_ns).encode())

    def _log(self, channel: str, data: bytes) -> None:
        self._channels[channel].log(data, log_time=self._log_ns)
