import dataclasses
import itertools
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from daemon.recorder import Recorder
from drivers.protocols import DeviceError
from drivers.recording.recording import LEFT_IMAGE, McapRecording
from messages import GroundTruth, Input, LastingInput, StereoFrame
from tests.bench.recorded import INFO, all_facts, facts, frame, inputs_of, record, walk

WALK = walk(1.2)
INPUTS = all_facts(inputs_of(WALK))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "walk.mcap"
    record(path, WALK)
    return path


def read(path: Path) -> tuple[list[Input], str | None]:
    source = McapRecording(path)
    return list(source.inputs()), source.damage


def is_beginning(part: list[object], whole: list[object]) -> bool:
    return part == whole[: len(part)]


def test_every_input_comes_back_in_the_order_of_the_pipeline(recording: Path) -> None:
    inputs, damage = read(recording)
    assert all_facts(inputs) == INPUTS
    assert damage is None
    assert {type(message) for message in inputs} == {type(message) for message in inputs_of(WALK)}


def test_frames_are_exact_and_own_read_only_pixels(recording: Path) -> None:
    frames = [message for message in read(recording)[0] if isinstance(message, StereoFrame)]
    sent = [message for message in WALK if isinstance(message, StereoFrame)]
    assert len(frames) == len(sent) > 5
    for got, want in zip(frames, sent, strict=True):
        assert np.array_equal(got.left, want.left)
        assert np.array_equal(got.right, want.right)
        assert got.left.dtype == np.uint8
        assert not got.left.flags.writeable


def test_what_the_recording_says_about_itself(recording: Path) -> None:
    source = McapRecording(recording)
    assert (source.device, source.source) == (INFO.device, INFO.source)
    assert source.calibration_text == INFO.calibration_text
    assert source.configuration_text == INFO.configuration_text


def test_utc_is_told_where_it_is_known(recording: Path, tmp_path: Path) -> None:
    assert McapRecording(recording).utc_offset_ns is None
    path = tmp_path / "utc.mcap"
    recorder = Recorder(path, dataclasses.replace(INFO, utc_offset_ns=1_795_000_000_123_456_789))
    recorder.close()
    assert McapRecording(path).utc_offset_ns == 1_795_000_000_123_456_789


def test_truth_is_told_apart_and_never_among_the_inputs(recording: Path) -> None:
    source = McapRecording(recording)
    sent = [message for message in WALK if isinstance(message, GroundTruth)]
    found = source.truth()
    assert [facts(found[truth.t_exposure_ns]) for truth in sent] == all_facts(sent)
    assert len(found) == len(sent)


def test_two_recordings_of_the_same_messages_are_the_same_file(recording: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.mcap"
    record(again, WALK)
    assert again.read_bytes() == recording.read_bytes()


def test_a_recording_of_what_was_read_reads_the_same(recording: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.mcap"
    record(again, read(recording)[0])
    assert all_facts(read(again)[0]) == INPUTS


def chunk_offsets(content: bytes) -> list[int]:
    offsets, place = [], 8
    while content[place] != 0x0F:
        if content[place] == 0x06:
            offsets.append(place)
        place += 9 + int.from_bytes(content[place + 1 : place + 9], "little")
    return offsets


def opening_bytes(recording: Path) -> int:
    """How much a reader needs to open a recording: all before the first chunk, and that chunk's kind and length."""
    return chunk_offsets(recording.read_bytes())[0] + 9


def cut_copy(recording: Path, folder: Path, size: int) -> Path:
    path = folder / "cut.mcap"
    path.write_bytes(recording.read_bytes()[:size])
    return path


@settings(deadline=None, max_examples=60)
@given(st.data())
def test_a_cut_recording_is_read_up_to_the_cut(
    recording: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    whole = recording.stat().st_size
    size = data.draw(st.integers(0, whole - 1))
    path = cut_copy(recording, tmp_path_factory.mktemp("cut"), size)
    if size < opening_bytes(recording) and size != opening_bytes(recording) - 9:
        with pytest.raises(DeviceError, match=re.escape(f"{path}: ")):
            McapRecording(path)
        return
    inputs, damage = read(path)
    assert is_beginning(all_facts(inputs), INPUTS)
    assert damage is not None
    assert damage.startswith(f"{path}: ")
    assert "\n" not in damage
    # Of what stands before the cut nothing but the message in hand, at most a frame of two images, is lost.
    share = (size - 10_000) / whole
    assert len(inputs) >= int(share * len(INPUTS) * 0.7) - 20


@settings(deadline=None, max_examples=150)
@given(st.data())
def test_a_flipped_byte_never_changes_what_is_read(
    recording: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    content = bytearray(recording.read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    content[place] ^= data.draw(st.integers(1, 255))
    path = tmp_path_factory.mktemp("flip") / "flip.mcap"
    path.write_bytes(content)
    try:
        source = McapRecording(path)
        inputs = list(source.inputs())
    except DeviceError:  # what stands before the first message cannot be used
        assert place < opening_bytes(recording)
        return
    assert is_beginning(all_facts(inputs), INPUTS)
    assert len(inputs) == len(INPUTS) or source.damage is not None
    assert source.calibration_text == INFO.calibration_text
    assert source.configuration_text == INFO.configuration_text


def test_a_chunk_whose_kind_was_flipped_is_missed(recording: Path, tmp_path: Path) -> None:
    content = recording.read_bytes()
    for offset in chunk_offsets(content)[1:]:
        for kind in (0x01, 0x07, 0x09, 0x0C, 0x0F):
            changed = bytearray(content)
            changed[offset] = kind
            path = tmp_path / "kind.mcap"
            path.write_bytes(changed)
            inputs, damage = read(path)
            assert is_beginning(all_facts(inputs), INPUTS)
            assert len(inputs) < len(INPUTS)
            assert damage is not None


def test_a_missing_chunk_is_noticed(recording: Path, tmp_path: Path) -> None:
    content = recording.read_bytes()
    _, second, third, *_ = chunk_offsets(content)
    path = tmp_path / "hole.mcap"
    path.write_bytes(content[:second] + content[third:])
    inputs, damage = read(path)
    assert is_beginning(all_facts(inputs), INPUTS)
    assert damage is not None
    assert "goes from message" in damage


def test_a_cut_within_the_index_loses_nothing_and_is_told(recording: Path, tmp_path: Path) -> None:
    path = cut_copy(recording, tmp_path, recording.stat().st_size - 5)
    inputs, damage = read(path)
    assert all_facts(inputs) == INPUTS
    assert damage == f"{path}: its index is cut off; every message was read"


def test_truth_of_a_cut_recording_is_what_stands_before_the_cut(recording: Path, tmp_path: Path) -> None:
    source = McapRecording(cut_copy(recording, tmp_path, recording.stat().st_size // 2))
    found = source.truth()
    sent = [message.t_exposure_ns for message in WALK if isinstance(message, GroundTruth)]
    assert 2 < len(found) < len(sent)
    assert list(found) == sent[: len(found)]
    assert source.damage is not None


def test_a_killed_recorder_leaves_all_but_the_newest_frame(tmp_path: Path) -> None:
    path = tmp_path / "killed.mcap"
    script = (
        "import os, signal, sys; from pathlib import Path; from tests.bench.recorded import record, walk;"
        "recorder = record(Path(sys.argv[1]), walk(1.2), close=False); os.kill(os.getpid(), signal.SIGKILL)"
    )
    root = Path(__file__).parents[3]
    done = subprocess.run([sys.executable, "-c", script, str(path)], cwd=root, check=False, timeout=60)
    assert done.returncode == -signal.SIGKILL
    inputs, damage = read(path)
    assert is_beginning(all_facts(inputs), INPUTS)
    last_frame = max(place for place, message in enumerate(inputs_of(WALK)) if isinstance(message, StereoFrame))
    assert len(inputs) >= last_frame
    assert damage is not None


def test_the_ring_keeps_exactly_the_newest_seconds(tmp_path: Path) -> None:
    path = tmp_path / "ring.mcap"
    messages = walk(3.0)
    recorder = record(path, messages, last_s=0.5)
    assert recorder.ring_s == pytest.approx(0.5)
    inputs, damage = read(path)
    assert damage is None
    # All arrivals after the newest one's half second; the walk's ankle states, ticks and frames lag behind it.
    newest_ns = max(message.t_arrival_ns for message in messages if hasattr(message, "t_arrival_ns"))
    first = next(
        place
        for place, message in enumerate(messages)
        if hasattr(message, "t_arrival_ns") and message.t_arrival_ns >= newest_ns - 500_000_000
    )
    assert all_facts(after_decisions(inputs)) == all_facts(inputs_of(messages[first:]))


def after_decisions(inputs: list[Input]) -> list[Input]:
    """Return a ring's inputs without the decisions before its first moment, which it keeps because they still hold."""
    return list(itertools.dropwhile(lambda message: isinstance(message, LastingInput), inputs))


def test_the_ring_is_bounded_in_bytes(tmp_path: Path) -> None:
    from daemon.recorder import Recorder

    path = tmp_path / "ring.mcap"
    recorder = Recorder(path, INFO, last_s=60.0, ring_bytes=100_000)
    messages = walk(2.0, 64, 64)
    for message in messages:
        recorder.offer(message)
        recorder.drain(timeout_s=0.0)
    assert 0.1 < recorder.ring_s < 1.5
    recorder.close()
    inputs, damage = read(path)
    assert damage is None
    kept = after_decisions(inputs)
    assert all_facts(kept) == all_facts(inputs_of(messages))[-len(kept) :]
    assert path.stat().st_size < 200_000


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"", "is empty"),
        (b"RIFF" * 100, "is no MCAP file"),
        (b"\x89MCAP0\r\n", "is no recording of GaitEyes (no metadata 'gaiteyes')"),
    ],
)
def test_other_files_get_one_line(tmp_path: Path, content: bytes, line: str) -> None:
    path = tmp_path / "other.mcap"
    path.write_bytes(content)
    with pytest.raises(DeviceError) as raised:
        McapRecording(path)
    assert str(raised.value) == f"{path}: {line}"


def test_an_absent_file_gets_one_line(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match=r"absent\.mcap: No such file or directory$"):
        McapRecording(tmp_path / "absent.mcap")


def test_another_programs_mcap_gets_one_line(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it so
    with pytest.raises(DeviceError, match=r"is no recording of GaitEyes"):
        McapRecording(path)


def foreign(path: Path, *, format_: str = "1", source: str = "live", frames: int = 0, compressed: bool = False) -> None:
    """An MCAP file with the opening of a recording, but not by the recorder."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD if compressed else CompressionType.NONE)
        writer.start()
        writer.add_metadata("gaiteyes", {"format": format_, "device": "bench", "source": source})
        for name in ("calibration.yaml", "configuration.toml"):
            writer.add_attachment(0, 0, name, "text/plain", b"")
        schema = writer.register_schema("gaiteyes.FrameHeader", "jsonschema", b"{}")
        channel = writer.register_channel("frame_header", "json", schema)
        for seq in range(frames):
            data = b'{"seq":%d,"t_exposure_ns":0,"t_arrival_ns":0,"exposure_s":0,"width_px":32,"height_px":20}' % seq
            writer.add_message(channel, 0, data, 0, seq)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it so


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"format_": "2"}, "its format is '2', allowed '1'"),
        ({"source": "dreamt"}, "its opening is damaged: 'dreamt' is not a valid Source"),
        ({}, "holds no input, on none of ankle, device_counters, dropped_frame, "),
        ({"frames": 1}, f"frame 0 has no image on channel '{LEFT_IMAGE}'"),
    ],
)
def test_a_recording_that_lacks_something_gets_one_line(tmp_path: Path, change: dict[str, object], line: str) -> None:
    path = tmp_path / "foreign.mcap"
    foreign(path, **change)  # type: ignore[arg-type]  # one value of each case
    with pytest.raises(DeviceError) as raised:
        list(McapRecording(path).inputs())
    assert str(raised.value).startswith(f"{path}: {line}")


def test_a_compressed_recording_says_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "compressed.mcap"
    foreign(path, frames=3, compressed=True)
    inputs, damage = read(path)
    assert inputs == []
    assert damage == f"{path}: its chunks are compressed (zstd): undo it with 'mcap decompress'"


def test_frames_of_another_size_get_one_line(tmp_path: Path) -> None:
    path = tmp_path / "sizes.mcap"
    record(path, [frame(0, 10**9), frame(1, 2 * 10**9, 48, 20)])
    inputs = McapRecording(path).inputs()
    next(inputs)
    with pytest.raises(DeviceError) as raised:
        next(inputs)
    assert str(raised.value) == (
        f"{path}: frame 1 is 48x20 px on channel 'frame/left', allowed 32x20 px as in the first header"
    )
