"""One MCAP file being written: channels that Foxglove shows, uncompressed images, one chunk for each frame.

What comes between two frames goes into the chunk of the later one; without frames a chunk ends after a second. So a
killed process loses what came since the last frame, or the newest second.
"""

import contextlib
import itertools
import logging
import os
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from foxglove import Channel, Context, Schema, open_mcap
from foxglove.mcap import MCAPWriteOptions
from foxglove.messages import RawImage, Timestamp

from daemon.state_file import format_learnt
from drivers.recording.recording import (
    ABOUT,
    CALIBRATION_FILE,
    CLOCK,
    CONFIGURATION_FILE,
    ENCODINGS,
    FORMAT,
    IMAGE_CHANNELS,
    LEARNT_FILE,
    OUTPUTS,
    UTC_OFFSET,
)
from messages import (
    TOPIC_OF,
    TOPICS,
    Estimate,
    Frame,
    FrameHeader,
    GroundTruth,
    Image,
    Input,
    Learnt,
    RecordingState,
    Source,
    UserError,
)
from messages.codec import encode, json_schema

log = logging.getLogger("gaiteyes")

Recordable = Input | Estimate | GroundTruth

RESERVE_BYTES = 500_000_000
"""Free space that a recording leaves on its disk."""

_HEADER_CHANNEL = TOPIC_OF[FrameHeader].name
_LARGEST_CHUNK_BYTES = 8 << 20
_LONGEST_CHUNK_NS = 1_000_000_000


class RecordingError(UserError):
    """A recording cannot be begun. One clear line for a person."""


@dataclass(frozen=True)
class RecordingInfo:
    """What a recording says about itself: the daemon's name, its data's source and the texts of its files.

    `learnt` is what the unit had learnt when the service began; None if that was nothing. `utc_offset_ns` is UTC less
    the clock of all messages; None where that clock is no real one.
    """

    device: str
    source: Source
    calibration_text: str
    configuration_text: str
    learnt: Learnt | None = None
    utc_offset_ns: int | None = None


class Entry(NamedTuple):
    """One message as it stands in the file. `log_time_ns` is where Foxglove shows it."""

    channel: str
    log_time_ns: int
    data: bytes


def entries_of(message: Recordable, log_time_ns: int) -> tuple[Entry, ...]:
    """Return the entries that hold `message`; images are copied, so that their buffers are free again.

    A frame's header comes last: a reader takes the frame for complete when it meets the header.
    """
    if not isinstance(message, Frame):
        return (Entry(TOPIC_OF[type(message)].name, log_time_ns, encode(message)),)
    header = message.header
    images = (
        Entry(channel, log_time_ns, _raw_image(header, image, frame_id))
        for (channel, frame_id), image in zip(IMAGE_CHANNELS[type(message)], message.images, strict=True)
    )
    return (*images, Entry(_HEADER_CHANNEL, log_time_ns, encode(header)))


def check_recordable(path: Path) -> None:
    """Raise RecordingError now, before long work, where a RecordingFile could not be created; leaves nothing behind."""
    was_there = path.exists()
    disk = _disk_with_room(path, RESERVE_BYTES)
    disk.close() if was_there else disk.remove()


class RecordingFile:
    """Creates `path` and writes entries into it in the order of the calls.

    A file that exists and is not empty is never overwritten. Raises RecordingError where it cannot be created, or where
    less than `reserve_bytes` are free. A failing disk afterwards never raises: `failed` becomes one line and everything
    later is thrown away. So it is when the reserve is reached; then the file is still closed with its index.
    """

    def __init__(
        self, path: Path, info: RecordingInfo, *, outputs_only: bool = False, reserve_bytes: int = RESERVE_BYTES
    ) -> None:
        self._disk = _disk_with_room(path, reserve_bytes)
        self._reserve_bytes = reserve_bytes
        self._stopped: str | None = None
        context = self._context = Context()  # kept, because its end closes its channels
        self._writer = open_mcap(
            self._disk,
            context=context,
            writer_options=MCAPWriteOptions(
                compression=None,
                chunk_size=_LARGEST_CHUNK_BYTES,
                calculate_data_section_crc=False,  # each chunk has its own
            ),
        )
        about = {"format": FORMAT, "device": info.device, "source": info.source.value}
        texts = {CALIBRATION_FILE: info.calibration_text, CONFIGURATION_FILE: info.configuration_text}
        if outputs_only:
            about["holds"] = OUTPUTS
        if info.utc_offset_ns is not None:
            about |= {CLOCK: "CLOCK_MONOTONIC", UTC_OFFSET: str(info.utc_offset_ns)}
        if info.learnt is not None:
            about["learnt"] = info.learnt.id
            texts[LEARNT_FILE] = format_learnt(info.learnt)
        self._writer.write_metadata(ABOUT, about)
        for name, text in texts.items():
            self._writer.attach(log_time=0, create_time=0, name=name, media_type="text/plain", data=text.encode())
        self._channels = {
            topic.name: Channel(
                topic.name, message_encoding="json", schema=viewer_schema(topic.message), context=context
            )
            for topic in TOPICS.values()
            if topic.message not in IMAGE_CHANNELS
        }
        for name, _ in itertools.chain.from_iterable(IMAGE_CHANNELS.values()):
            self._channels[name] = Channel(
                name, message_encoding="protobuf", schema=RawImage.get_schema(), context=context
            )
        self._chunk_due_ns = 0
        self._end_chunk()
        if self._disk.failed is not None:
            self.close()
            raise RecordingError(self._disk.failed)

    @property
    def failed(self) -> str | None:
        """Return why writing stopped, or None while all is well."""
        return self._disk.failed or self._stopped

    @property
    def state(self) -> RecordingState:
        """Return the same in one word."""
        if self._disk.failed is not None:
            return RecordingState.DISK_FAILED
        return RecordingState.RECORDING if self._stopped is None else RecordingState.DISK_FULL

    def write(self, entries: tuple[Entry, ...]) -> bool:
        """Write the entries of one message; return False if writing has stopped, now or before."""
        if self._stopped is not None:
            return False
        for channel, log_time_ns, data in entries:
            self._channels[channel].log(data, log_time=log_time_ns)
        last = entries[-1]
        if last.channel == _HEADER_CHANNEL or last.log_time_ns >= self._chunk_due_ns:
            self._end_chunk()
            self._chunk_due_ns = last.log_time_ns + _LONGEST_CHUNK_NS
            if self._disk.failed is None and not self._disk.has_room(self._reserve_bytes):
                self._stopped = (
                    f"recording {self._disk.path} stopped: only {_mb(self._reserve_bytes)} are left on its disk"
                )
                log.error("%s", self._stopped)
        return self._disk.failed is None

    def close(self) -> None:
        """Write the index and close the file."""
        self._writer.close()
        self._disk.close()

    def _end_chunk(self) -> None:
        self._writer.flush()
        self._disk.mark_sound_end()


class _Disk:
    """The file as the MCAP writer sees it, which must go on as if nothing were wrong: it aborts if it meets an error.

    At the first error the file is cut back to its sound end and left alone; only the position is kept up.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._position = self._end = self._sound_end = 0
        self.failed: str | None = None
        try:
            if path.exists() and path.stat().st_size > 0:
                raise RecordingError(f"{path}: exists already, and a recording overwrites nothing")
            self._file = path.open("wb", buffering=0)
        except OSError as error:
            raise RecordingError(f"{path}: cannot record here: {error.strerror}") from error

    def write(self, data: bytes | bytearray) -> int:
        written = len(data)
        if self.failed is None:
            try:
                written = self._file.write(data)
            except OSError as error:
                self._fail(error)
        self._position += written
        self._end = max(self._end, self._position)
        return written

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        position = offset + (0, self._position, self._end)[whence]
        if position != self._position and self.failed is None:
            self._file.seek(position)
        self._position = position
        return position

    def has_room(self, bytes_free: int) -> bool:
        """Return whether so much is free beside the file; a device such as /dev/null is never full."""
        if not stat.S_ISREG(os.fstat(self._file.fileno()).st_mode):
            return True
        disk = os.fstatvfs(self._file.fileno())
        return disk.f_bavail * disk.f_frsize >= bytes_free

    def remove(self) -> None:
        """Close the file, to which nothing was written, and remove it."""
        self._file.close()
        self.path.unlink(missing_ok=True)

    def flush(self) -> None:
        """Do nothing: the file has no buffer."""

    def mark_sound_end(self) -> None:
        """Declare all that was written so far worth keeping."""
        self._sound_end = self._end

    def close(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        self.failed = f"recording {self.path} stopped: {error.strerror}"
        log.error("%s", self.failed)
        with contextlib.suppress(OSError):  # the disk may be gone altogether
            self._file.truncate(self._sound_end)


def _disk_with_room(path: Path, reserve_bytes: int) -> _Disk:
    disk = _Disk(path)
    if not disk.has_room(reserve_bytes):
        disk.remove()
        raise RecordingError(f"{path}: cannot record here: less than {_mb(reserve_bytes)} are free on its disk")
    return disk


def _mb(count: int) -> str:
    return f"{count / 1e6:g} MB"


def viewer_schema(message: type[msgspec.Struct]) -> Schema:
    """Return the JSON Schema of `message` in the few words that Foxglove's reader knows.

    It throws on `$ref`, on a list of types and on `prefixItems`; so references are replaced by what they refer to,
    `number or null` by `number`, and a tuple by an array. A null is still shown as what it is.
    """
    schema = json_schema(TOPIC_OF[message])
    plain = _plain(schema, schema["$defs"])
    return Schema(name=f"gaiteyes.{message.__name__}", encoding="jsonschema", data=msgspec.json.encode(plain))


def _plain(node: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    if "$ref" in node:
        return _plain(definitions[node["$ref"].rpartition("/")[2]], definitions)
    if "enum" in node:
        return {"type": "string", "enum": node["enum"]}
    if node["type"] == "object":
        fields = node.get("properties", {})
        return {"type": "object", "properties": {name: _plain(field, definitions) for name, field in fields.items()}}
    if node["type"] == "array":
        each = node["prefixItems"][0] if "prefixItems" in node else node["items"]
        return {"type": "array", "items": _plain(each, definitions)}
    return {"type": "number" if isinstance(node["type"], list) else node["type"]}


def _raw_image(header: FrameHeader, image: Image, frame_id: str) -> bytes:
    seconds, nanoseconds = divmod(max(header.t_exposure_ns, 0), 1_000_000_000)
    return RawImage(
        timestamp=Timestamp(sec=seconds, nsec=nanoseconds),
        frame_id=frame_id,
        width=image.shape[1],
        height=image.shape[0],
        encoding=ENCODINGS[image.dtype],
        step=image.shape[1] * image.itemsize,
        data=image.tobytes(),
    ).encode()
