"""The messages of an uncompressed MCAP file in the order of the file, up to the first damage.

A chunk that is whole must match its CRC; of one that the end of the file cuts, the whole messages count. The
messages of a channel are numbered without a gap, so that a lost chunk shows. Mere readers of MCAP skip what they do
not know and trust what they get, which is not good enough for a replay.

Only chunked files, as the recorder writes them. Format: https://mcap.dev/spec. A record is opcode u8, length u64,
content; numbers are little-endian.
"""

import struct
import zlib
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema

from drivers.protocols import DeviceError

_MAGIC = b"\x89MCAP0\r\n"
_RECORD_HEAD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQII")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_DATA_END_LENGTH = 4
_UNFINISHED = 2**64 - 1
"""The length of a chunk that was being written when the recorder died."""

_PARSE_ERRORS = (McapError, struct.error, UnicodeDecodeError, OverflowError)


class DamageError(Exception):
    """The file cannot be trusted from here on. One line without the file's name."""


class McapMessage(NamedTuple):
    """One message and the schema of its channel."""

    channel: str
    data: bytes
    schema: Schema


class Opening(NamedTuple):
    """What stands before the first message: metadata records and attached texts by their names."""

    metadata: dict[str, dict[str, str]]
    texts: dict[str, str]


class _Record(NamedTuple):
    offset: int
    opcode: int
    length: int
    content: memoryview

    @property
    def cut(self) -> bool:
        """Return whether the content ends before its stated length."""
        return len(self.content) < self.length


class McapFile:
    """Reads `path`; raises DeviceError, one line, if it cannot be opened or is no MCAP file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with self._open() as file:
            start = file.read(len(_MAGIC))
        if not start:
            raise DeviceError(f"{path}: is empty")
        if start != _MAGIC:
            raise DeviceError(f"{path}: is no MCAP file")

    def opening(self) -> Opening:
        """Return all that stands before the first message; raises DamageError."""
        opening = Opening({}, {})
        with self._open() as file:
            for record in _file_records(file):
                if record.opcode in (Opcode.CHUNK, Opcode.DATA_END):
                    break
                if record.cut:
                    raise DamageError(f"cut off at byte {record.offset + len(record.content)}")
                try:
                    _keep(record, opening)
                except _PARSE_ERRORS as error:
                    raise DamageError(f"damaged at byte {record.offset}: {error}") from error
        return opening

    def messages(self, channels: Collection[str]) -> Iterator[McapMessage]:
        """Yield the messages of `channels` in the order of the file; raises DamageError where the file is damaged."""
        directory = _Directory(frozenset(channels))
        with self._open() as file:
            for record in _file_records(file):
                if record.opcode == Opcode.CHUNK:
                    yield from _chunk_messages(record, directory)
                if record.cut:
                    raise DamageError(f"cut off at byte {record.offset + len(record.content)}")
                if record.opcode == Opcode.DATA_END and record.length == _DATA_END_LENGTH:
                    _check_end(file)
                    return
                if record.opcode != Opcode.CHUNK:
                    _check_other(record)
        raise DamageError("the recording was not closed: its end is missing")

    def _open(self) -> BinaryIO:
        try:
            return self._path.open("rb")
        except OSError as error:
            raise DeviceError(f"{self._path}: {error.strerror}") from error


class _Directory:
    """The channels and schemas met so far, and the number of each channel's latest message."""

    def __init__(self, wanted: frozenset[str]) -> None:
        self._wanted = wanted
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._sequences: dict[int, int] = {}

    def take(self, record: _Record) -> Iterator[McapMessage]:
        """Learn a schema or channel, or yield a message if it is wanted; raises DamageError."""
        try:
            if record.opcode == Opcode.SCHEMA:
                schema = Schema.read(_stream(record.content))
                self._schemas[schema.id] = schema
            elif record.opcode == Opcode.CHANNEL:
                channel = Channel.read(_stream(record.content))
                self._channels[channel.id] = channel
            elif record.opcode == Opcode.MESSAGE:
                channel = self._next_message_on(record)
                if channel.topic in self._wanted:
                    data = bytes(record.content[_MESSAGE_HEAD.size :])
                    yield McapMessage(channel.topic, data, self._schemas[channel.schema_id])
        except (*_PARSE_ERRORS, KeyError) as error:
            raise DamageError(f"damaged at byte {record.offset}: {error!r}") from error

    def _next_message_on(self, record: _Record) -> Channel:
        channel_id, sequence, _, _ = _MESSAGE_HEAD.unpack_from(record.content)
        channel = self._channels[channel_id]
        expected = self._sequences.get(channel_id, sequence - 1) + 1
        if sequence != expected:
            raise DamageError(
                f"damaged before byte {record.offset}: channel '{channel.topic}' goes from message {expected - 1} "
                f"to {sequence}"
            )
        self._sequences[channel_id] = sequence
        return channel


def _file_records(file: BinaryIO) -> Iterator[_Record]:
    """Yield the records of the file; the content of the last one may be cut."""
    size = file.seek(0, 2)
    offset = file.seek(len(_MAGIC))
    while offset < size:
        if size - offset < _RECORD_HEAD.size:
            raise DamageError(f"cut off at byte {size}")
        try:
            head = file.read(_RECORD_HEAD.size)
            opcode, length = _RECORD_HEAD.unpack(head)
            content = file.read(min(length, size - offset - len(head)))
        except OSError as error:
            raise DamageError(f"cannot be read at byte {offset}: {error.strerror}") from error
        yield _Record(offset, opcode, length, memoryview(content))
        offset += len(head) + length


def _chunk_messages(chunk: _Record, directory: _Directory) -> Iterator[McapMessage]:
    """Yield the wanted messages of a chunk: all if its CRC holds, the whole ones if the file ends within it."""
    try:
        _, _, size, crc, name_length = _CHUNK_HEAD.unpack_from(chunk.content)
        start = _CHUNK_HEAD.size + name_length + 8
        compression = str(chunk.content[_CHUNK_HEAD.size :][:name_length], "utf-8")
        (data_length,) = struct.unpack_from("<Q", chunk.content, start - 8)
    except (struct.error, UnicodeDecodeError) as error:
        if chunk.cut:
            return
        raise DamageError(f"damaged at byte {chunk.offset}: {error}") from error
    if compression:
        raise DamageError(f"its chunks are compressed ({compression}): undo it with 'mcap decompress'")
    data = chunk.content[start:]
    sizes_agree = data_length == size == chunk.length - start or chunk.length == _UNFINISHED
    if not sizes_agree or (not chunk.cut and crc and zlib.crc32(data) != crc):
        raise DamageError(f"damaged at byte {chunk.offset}: the chunk does not match its checksum")
    for record in _chunk_records(data, chunk.offset + _RECORD_HEAD.size + start):
        if record.cut and not chunk.cut:
            raise DamageError(f"damaged at byte {record.offset}: a record is longer than its chunk")
        if not record.cut:
            yield from directory.take(record)


def _chunk_records(data: memoryview, offset: int) -> Iterator[_Record]:
    place = 0
    while place + _RECORD_HEAD.size <= len(data):
        opcode, length = _RECORD_HEAD.unpack_from(data, place)
        content = data[place + _RECORD_HEAD.size :][:length]
        yield _Record(offset + place, opcode, length, content)
        place += _RECORD_HEAD.size + length


def _check_end(file: BinaryIO) -> None:
    file.seek(-len(_MAGIC), 2)
    if file.read() != _MAGIC:
        raise DamageError("its index is cut off; every message was read")


def _check_other(record: _Record) -> None:
    """Raise DamageError unless the record is a sound one that holds no message: an overlooked chunk would be a gap."""
    try:
        if record.opcode == Opcode.MESSAGE_INDEX:
            (entries_length,) = struct.unpack_from("<I", record.content, 2)
            sound = record.length == 6 + entries_length
        elif record.opcode == Opcode.HEADER:
            sound = record.offset == len(_MAGIC)
        else:
            sound = _keep(record, Opening({}, {}))
    except _PARSE_ERRORS as error:
        raise DamageError(f"damaged at byte {record.offset}: {error}") from error
    if not sound:
        raise DamageError(f"damaged at byte {record.offset}: unexpected record {record.opcode}")


def _keep(record: _Record, opening: Opening) -> bool:
    """Put a metadata record or an attachment into `opening`; return whether it was one and is whole."""
    stream = _stream(record.content)
    if record.opcode == Opcode.METADATA:
        metadata = Metadata.read(stream)
        opening.metadata[metadata.name] = metadata.metadata
    elif record.opcode == Opcode.ATTACHMENT:
        attachment = Attachment.read(stream)
        (crc,) = struct.unpack("<I", record.content[-4:])
        if crc and zlib.crc32(record.content[:-4]) != crc:
            raise DamageError(f"damaged at byte {record.offset}: '{attachment.name}' does not match its checksum")
        opening.texts[attachment.name] = str(attachment.data, "utf-8")
    else:
        return False
    return stream.count == record.length


def _stream(content: memoryview) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))
