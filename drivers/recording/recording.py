"""A recording as one more device: every input comes back in the order in which the pipeline took it.

The order is that of the file; times are never sorted. A frame is one or two image messages and then its header, so
that one cut in the middle does not exist.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from google.protobuf.message import DecodeError  # type: ignore[import-untyped]  # protobuf comes without types
from mcap.exceptions import McapError
from mcap_protobuf.decoder import DecoderFactory
from numpy.typing import NDArray

from drivers.protocols import DeviceError
from drivers.recording.mcap_file import DamageError, McapFile, McapMessage
from messages import (
    TOPIC_OF,
    AnkleState,
    DepthFrame,
    DeviceCounters,
    DroppedFrame,
    Frame,
    FrameHeader,
    GroundTruth,
    ImuSample,
    Input,
    LoadLevel,
    Reconfigured,
    Source,
    StereoFrame,
    Tick,
)
from messages.codec import decode

LEFT_IMAGE, RIGHT_IMAGE, DEPTH_IMAGE = "frame/left", "frame/right", "frame/depth"
IMAGE_CHANNELS: dict[type[msgspec.Struct], tuple[tuple[str, str], ...]] = {
    StereoFrame: ((LEFT_IMAGE, "L"), (RIGHT_IMAGE, "R")),
    DepthFrame: ((DEPTH_IMAGE, "D"),),
}
"""The channel of foxglove.RawImage and the camera's frame, for each image of a frame of either kind."""

ENCODINGS: dict[np.dtype[Any], str] = {np.dtype("<u1"): "mono8", np.dtype("<u2"): "16UC1"}
"""What foxglove.RawImage calls the pixels."""

ABOUT = "gaiteyes"
"""The metadata record with `format`, `device` and `source`, and the id of what the unit had `learnt`, if anything."""

OUTPUTS = "outputs"
"""In ABOUT's field `holds`: estimates alone, nothing to replay."""

CLOCK, UTC_OFFSET = "clock", "utc_offset_ns"
"""In ABOUT, where it is known: the clock of all times, and what is to be added to them for UTC, ns since 1970."""

FORMAT = "1"
CALIBRATION_FILE, CONFIGURATION_FILE, LEARNT_FILE = "calibration.yaml", "configuration.toml", "learnt.json"
"""The attached texts; the last only where the unit had learnt something before."""

_HEADER_CHANNEL = TOPIC_OF[FrameHeader].name
_TRUTH_CHANNEL = TOPIC_OF[GroundTruth].name
_JSON_INPUTS: dict[str, type[Input]] = {
    TOPIC_OF[kind].name: kind
    for kind in (ImuSample, DroppedFrame, AnkleState, Tick, LoadLevel, Reconfigured, DeviceCounters)
}
_GREY, _DEPTH = ENCODINGS
_CHANNEL_PIXELS = {LEFT_IMAGE: _GREY, RIGHT_IMAGE: _GREY, DEPTH_IMAGE: _DEPTH}
_INPUT_CHANNELS = frozenset({*_JSON_INPUTS, *_CHANNEL_PIXELS, _HEADER_CHANNEL})

M = TypeVar("M", bound=msgspec.Struct)


class McapRecording:
    """The recording in the file `path`.

    `device`, `source` (live or simulated), `calibration_text`, `configuration_text` and `learnt_text` (None where the
    unit had learnt nothing before) are those of the daemon that recorded it; `utc_offset_ns` is UTC less the clock of
    all times, None where the recording does not tell it. `damage` is one line that tells, after
    `inputs` or `truth`, where and why reading had to stop before the recording's end; None if it did not. Raises
    DeviceError, one line, if the file is no recording of GaitEyes, is another version's, or is damaged before its first
    message.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = McapFile(path)
        self._decoders = DecoderFactory()
        self.damage: str | None = None
        try:
            metadata, texts = self._file.opening()
        except DamageError as damage:
            raise DeviceError(f"{path}: {damage}") from damage
        if ABOUT not in metadata:
            raise DeviceError(f"{path}: is no recording of GaitEyes (no metadata '{ABOUT}')")
        about = metadata[ABOUT]
        if about.get("format") != FORMAT:
            raise DeviceError(f"{path}: its format is '{about.get('format')}', allowed '{FORMAT}'")
        try:
            self._outputs_only = about.get("holds") == OUTPUTS
            self.device = about["device"]
            self.source = Source(about["source"])
            self.utc_offset_ns = int(about[UTC_OFFSET]) if UTC_OFFSET in about else None
            self.calibration_text = texts[CALIBRATION_FILE]
            self.configuration_text = texts[CONFIGURATION_FILE]
            self.learnt_text = texts[LEARNT_FILE] if "learnt" in about else None
        except (KeyError, ValueError) as error:
            raise DeviceError(f"{path}: its opening is damaged: {error}") from error

    def inputs(self) -> Iterator[Input]:
        """Yield every input in the recorded order; images are read-only and bit for bit what the camera gave.

        At damage the iteration ends and `damage` is set. Raises DeviceError for a frame without its images or of
        another size than its header's or the first frame's, and for a recording without any input.
        """
        images: dict[str, NDArray[Any]] = {}
        first: FrameHeader | None = None
        empty = True
        try:
            for message in self._file.messages(_INPUT_CHANNELS):
                if message.channel in _CHANNEL_PIXELS:
                    images[message.channel] = self._image(message)
                    continue
                if message.channel == _HEADER_CHANNEL:
                    header = _decoded(message, FrameHeader)
                    first = first or header
                    yield self._frame(header, images, first)
                    images = {}
                else:
                    yield _decoded(message, _JSON_INPUTS[message.channel])
                empty = False
        except DamageError as damage:
            self.damage = f"{self._path}: {damage}"
            return
        if empty and self._outputs_only:
            raise DeviceError(f"{self._path}: holds outputs only, recorded without inputs: nothing to replay")
        if empty:
            raise DeviceError(f"{self._path}: holds no input, on none of {', '.join(sorted(_INPUT_CHANNELS))}")

    def truth(self) -> dict[int, GroundTruth]:
        """Return the rig's truth by `t_exposure_ns`, up to the damage if there is any; empty for a live recording."""
        found: dict[int, GroundTruth] = {}
        try:
            for message in self._file.messages({_TRUTH_CHANNEL}):
                truth = _decoded(message, GroundTruth)
                found[truth.t_exposure_ns] = truth
        except DamageError as damage:
            self.damage = f"{self._path}: {damage}"
        return found

    def _image(self, message: McapMessage) -> NDArray[Any]:
        pixels = _CHANNEL_PIXELS[message.channel]
        try:
            decode_image = self._decoders.decoder_for("protobuf", message.schema)
            if decode_image is None or message.schema.name != "foxglove.RawImage":
                raise DeviceError(f"{self._path}: channel '{message.channel}' holds no foxglove.RawImage")
            image = decode_image(message.data)
        except (McapError, DecodeError) as error:
            raise DamageError(f"an image on channel '{message.channel}' cannot be decoded: {error}") from error
        row_bytes = pixels.itemsize * image.width
        size_is_right = image.step == row_bytes and len(image.data) == row_bytes * image.height
        if image.encoding != ENCODINGS[pixels] or not size_is_right:
            raise DeviceError(
                f"{self._path}: an image on channel '{message.channel}' is {image.width}x{image.height} px, "
                f"{image.encoding}, {len(image.data)} bytes; allowed {ENCODINGS[pixels]} without padding"
            )
        return np.frombuffer(image.data, dtype=pixels).reshape(image.height, image.width)

    def _frame(self, header: FrameHeader, images: dict[str, NDArray[Any]], first: FrameHeader) -> Frame:
        allowed = f"{first.width_px}x{first.height_px} px"
        kind = DepthFrame if DEPTH_IMAGE in images else StereoFrame
        for channel, _ in IMAGE_CHANNELS[kind]:
            if channel not in images:
                raise DeviceError(f"{self._path}: frame {header.seq} has no image on channel '{channel}'")
            height_px, width_px = images[channel].shape
            if (width_px, height_px) != (first.width_px, first.height_px):
                raise DeviceError(
                    f"{self._path}: frame {header.seq} is {width_px}x{height_px} px on channel '{channel}', "
                    f"allowed {allowed} as in the first header"
                )
        if (header.width_px, header.height_px) != (first.width_px, first.height_px):
            raise DeviceError(
                f"{self._path}: the header of frame {header.seq} says {header.width_px}x{header.height_px} px, "
                f"allowed {allowed} as in the first header"
            )
        if kind is DepthFrame:
            return DepthFrame(header=header, depth=images[DEPTH_IMAGE])
        return StereoFrame(header=header, left=images[LEFT_IMAGE], right=images[RIGHT_IMAGE])


def _decoded(message: McapMessage, kind: type[M]) -> M:
    try:
        return decode(message.data, kind)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise DamageError(f"a message on channel '{message.channel}' is no {kind.__name__}: {error}") from error
