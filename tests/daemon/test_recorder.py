import logging
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jsonschema  # type: ignore[import-untyped]  # it comes without types
import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from daemon.recorder import Recorder, RecordingError
from daemon.recording_file import check_recordable, entries_of, viewer_schema
from daemon.recording_ring import RecordingRing
from drivers.camera.frame_pool import FramePool
from drivers.protocols import DeviceError
from drivers.recording.recording import IMAGE_CHANNELS, McapRecording
from messages import (
    TOPICS,
    DropCause,
    DroppedFrame,
    ImuSample,
    Input,
    Load,
    LoadLevel,
    Reconfigured,
    RecordingState,
    StereoFrame,
    Tick,
)
from messages.codec import json_schema
from tests.bench.recorded import INFO, all_facts, frame, header, imu, inputs_of, record, walk

ROOT = Path(__file__).parents[2]


def test_a_full_queue_turns_frames_into_headers_and_drops_the_rest_counted(tmp_path: Path) -> None:
    path = tmp_path / "full.mcap"
    recorder = Recorder(path, INFO, queue_frames=2, queue_messages=5)
    for seq in range(4):
        recorder.offer(frame(seq, seq))
    recorder.offer(imu(0, 4))
    recorder.offer(imu(1, 5))
    recorder.offer(frame(5, 6))
    assert recorder.dropped_by_kind == {"frame": 3, "imu": 1}
    assert recorder.dropped == 4
    recorder.drain(timeout_s=0.0)
    recorder.offer(frame(6, 7))
    recorder.close()
    inputs = list(McapRecording(path).inputs())
    assert [type(message) for message in inputs] == [
        StereoFrame,
        StereoFrame,
        DroppedFrame,
        DroppedFrame,
        ImuSample,
        StereoFrame,
    ]
    lost = inputs[2]
    assert isinstance(lost, DroppedFrame)
    assert (lost.header.seq, lost.cause) == (2, DropCause.NOT_RECORDED)


def test_what_comes_after_the_end_is_counted_as_dropped(tmp_path: Path) -> None:
    recorder = record(tmp_path / "closed.mcap", [Tick(t_ns=1)])
    recorder.offer(Tick(t_ns=2))
    recorder.close()
    assert recorder.dropped_by_kind == {"tick": 1}
    assert recorder.idle
    assert len(list(McapRecording(tmp_path / "closed.mcap").inputs())) == 1


def test_close_records_what_still_waits(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "late.mcap", INFO)
    for k in range(50):
        recorder.offer(Tick(t_ns=k))
    assert not recorder.idle
    recorder.close()
    assert list(McapRecording(tmp_path / "late.mcap").inputs()) == [Tick(t_ns=k) for k in range(50)]


def test_one_thread_offers_while_another_drains(tmp_path: Path) -> None:
    path = tmp_path / "threads.mcap"
    recorder = Recorder(path, INFO)
    done = threading.Event()

    def write() -> None:
        while not (done.is_set() and recorder.idle):
            recorder.drain(timeout_s=0.01)

    writer = threading.Thread(target=write)
    writer.start()
    messages = walk(4.0)
    for place, message in enumerate(messages):
        recorder.offer(message)
        if place % 50 == 0:
            threading.Event().wait(0.001)
    done.set()
    writer.join()
    recorder.close()
    assert recorder.dropped_by_kind.keys() <= {"frame"}
    inputs = list(McapRecording(path).inputs())
    assert len(inputs) == len(inputs_of(messages))


@pytest.mark.parametrize("last_s", [None, 10.0])
def test_no_pixel_buffer_is_held_once_drained(tmp_path: Path, last_s: float | None) -> None:
    pool = FramePool(3, 32, 20)
    recorder = Recorder(tmp_path / "pool.mcap", INFO, last_s=last_s)
    for seq in range(12):
        pair = pool.take()
        assert pair is not None
        pair.left[:] = pair.right[:] = seq
        recorder.offer(pair.frame(header(seq, seq)))
        del pair
        if seq % 3 == 2:
            assert pool.free == 0
            recorder.drain(timeout_s=0.0)
            assert pool.free == 3
    recorder.close()
    frames = [message for message in McapRecording(tmp_path / "pool.mcap").inputs() if isinstance(message, StereoFrame)]
    assert [int(found.left[0, 0]) for found in frames] == list(range(12))


def test_a_file_of_somebody_else_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "kept.mcap"
    path.write_text("precious")
    with pytest.raises(RecordingError) as raised:
        Recorder(path, INFO)
    assert str(raised.value) == f"{path}: exists already, and a recording overwrites nothing"
    assert path.read_text() == "precious"


def test_an_empty_file_made_beforehand_is_used(tmp_path: Path) -> None:
    path = tmp_path / "made.mcap"
    path.touch()
    record(path, [Tick(t_ns=1)])
    assert len(list(McapRecording(path).inputs())) == 1


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("absent/x.mcap", "cannot record here: No such file or directory"),
        (".", "exists already, and a recording overwrites nothing"),
        ("/dev/full", "stopped: No space left on device"),
    ],
)
def test_a_place_that_cannot_be_written_gets_one_line(
    tmp_path: Path, name: str, line: str, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(RecordingError, match=f"{line}$"):
        Recorder(tmp_path / name, INFO)


@pytest.mark.parametrize("name", ["absent/x.mcap", ".", "kept.mcap"])
def test_what_cannot_be_recorded_is_told_beforehand_in_the_same_words(tmp_path: Path, name: str) -> None:
    (tmp_path / "kept.mcap").write_text("precious")
    told = []
    for begin in (check_recordable, lambda path: Recorder(path, INFO)):
        with pytest.raises(RecordingError) as raised:
            begin(tmp_path / name)
        told.append(str(raised.value))
    assert told[0] == told[1]
    assert (tmp_path / "kept.mcap").read_text() == "precious"


def test_asking_beforehand_leaves_all_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "made.mcap").touch()
    for path in (tmp_path / "made.mcap", tmp_path / "new.mcap", Path("/dev/null")):
        there = path.exists()
        check_recordable(path)
        assert path.exists() is there


def test_a_ring_of_no_length_gets_one_line(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"^the newest -1 s cannot be kept, allowed above 0 s$"):
        Recorder(tmp_path / "ring.mcap", INFO, last_s=-1.0)


FULL_DISK = """
import logging, resource, sys
from pathlib import Path
from tests.bench.recorded import record, walk
logging.basicConfig(format="%(message)s")
resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
recorder = record(Path(sys.argv[1]), walk(1.5), last_s=float(sys.argv[2]) if len(sys.argv) > 2 else None)
print(recorder.failed)
print(recorder.dropped)
"""


@pytest.mark.parametrize("ring", [[], ["5.0"]])
def test_a_full_disk_stops_the_recording_with_one_line_and_leaves_it_readable(tmp_path: Path, ring: list[str]) -> None:
    path = tmp_path / "full.mcap"
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(path), *ring], cwd=ROOT, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    failed, dropped = done.stdout.splitlines()
    assert failed == f"recording {path} stopped: File too large"
    assert done.stderr.strip() == failed
    recording = McapRecording(path)
    inputs = list(recording.inputs())
    sent = inputs_of(walk(1.5))
    assert all_facts(inputs) == all_facts(sent)[: len(inputs)]
    assert 60 < len(inputs) < len(sent)
    assert recording.damage == f"{path}: the recording was not closed: its end is missing"
    assert int(dropped) > 100


def test_a_failure_is_kept_as_state_and_later_messages_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    recorder = Recorder(tmp_path / "gone.mcap", INFO)
    recorder.offer(frame(0, 1))
    recorder.drain(timeout_s=0.0)
    assert not recorder.failed
    recorder._file._disk._file.close()
    monkeypatch.setattr(recorder._file._disk, "_file", open("/dev/full", "wb", buffering=0))  # noqa: SIM115
    with caplog.at_level(logging.ERROR, logger="gaiteyes"):
        for k in range(1, 10):
            recorder.offer(frame(k, 1 + k))
            recorder.drain(timeout_s=0.0)
        recorder.close()
    assert recorder.failed == f"recording {tmp_path / 'gone.mcap'} stopped: No space left on device"
    assert recorder.dropped_by_kind == {"frame": 9}
    assert [entry.message for entry in caplog.records] == [recorder.failed]


def test_a_reserve_of_free_space_is_left_and_the_recording_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The disk's figures are made up: it fills by itself after five looks at it."""
    free_bytes = iter([3000] * 5 + [999] * 99)

    def filling(_file: int) -> SimpleNamespace:
        return SimpleNamespace(f_bavail=next(free_bytes), f_frsize=1)

    monkeypatch.setattr("daemon.recording_file.os.fstatvfs", filling)
    path = tmp_path / "filling.mcap"
    recorder = Recorder(path, INFO, reserve_bytes=1000)
    before = recorder.state
    with caplog.at_level(logging.ERROR, logger="gaiteyes"):
        for k in range(12):
            recorder.offer(frame(k, k))
            recorder.drain(timeout_s=0.0)
        recorder.close()
    assert recorder.failed == f"recording {path} stopped: only 0.001 MB are left on its disk"
    assert (before, recorder.state) == (RecordingState.RECORDING, RecordingState.DISK_FULL)
    assert [entry.message for entry in caplog.records] == [recorder.failed]
    recording = McapRecording(path)
    assert len(list(recording.inputs())) + recorder.dropped == 12
    assert recorder.dropped_by_kind == {"frame": 7}
    assert recording.damage is None


def test_no_recording_begins_below_the_reserve(tmp_path: Path) -> None:
    path = tmp_path / "walk.mcap"
    with pytest.raises(RecordingError) as refused:
        Recorder(path, INFO, reserve_bytes=10**18)
    assert str(refused.value) == f"{path}: cannot record here: less than 1e+12 MB are free on its disk"
    assert not path.exists()


def test_outputs_alone_hold_no_input_and_say_so(tmp_path: Path) -> None:
    path = tmp_path / "outputs.mcap"
    messages = walk(1.0)
    recorder = Recorder(path, INFO, outputs_only=True)
    for message in messages:
        recorder.offer(message)
        recorder.drain(timeout_s=0.0)
    recorder.close()
    assert recorder.dropped == 0
    found = read_by_others(path)
    assert {topic for topic, _, _ in found} == {"attitude", "ground", "truth"}
    assert len(found) == len(messages) - len(inputs_of(messages))
    assert [log_time for _, log_time, _ in found] == sorted(log_time for _, log_time, _ in found)
    assert found[0][1] >= 10**9
    with pytest.raises(DeviceError, match="holds outputs only, recorded without inputs: nothing to replay"):
        list(McapRecording(path).inputs())


@pytest.mark.parametrize("pictures", ["noise", "floor"])
def test_a_ring_gives_back_every_byte(pictures: str) -> None:
    rng = np.random.default_rng(1)
    made = [frame(k, k * 50_000_000, 320, 200) for k in range(20)]
    if pictures == "floor":
        even = (np.add.outer(np.arange(200), np.arange(320)) // 4).astype(np.uint8)
        made = [
            StereoFrame(header=shot.header, left=even + rng.integers(0, 3, even.shape, np.uint8), right=even)
            for shot in made
        ]
    ring = RecordingRing(60.0, 10**8)
    entries = [entries_of(shot, shot.header.t_arrival_ns) for shot in made]
    for each in entries:
        ring.append(StereoFrame, each)
    kept_bytes, whole_bytes = ring._bytes, sum(len(entry.data) for each in entries for entry in each)
    assert [each for _, each in ring.emptied()] == entries
    assert ring.span_s == pytest.approx(0.95)
    assert kept_bytes <= whole_bytes
    assert (kept_bytes < 0.5 * whole_bytes) == (pictures == "floor")


def test_a_ring_that_cannot_hold_its_seconds_says_so_once(caplog: pytest.LogCaptureFixture) -> None:
    ring = RecordingRing(60.0, 1 << 20)
    with caplog.at_level(logging.WARNING, logger="gaiteyes"):
        for k in range(30):
            ring.append(StereoFrame, entries_of(frame(k, k * 50_000_000, 320, 200), k * 50_000_000))
    (said,) = [entry.message for entry in caplog.records]
    assert said.startswith("the newest 60 s of these pictures take more than 1 MB: the recording keeps the newest 0.")
    assert ring.span_s < 0.6


# What a viewer needs


def read_by_others(path: Path) -> list[tuple[str, int, Any]]:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found: list[tuple[str, int, Any]] = []
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert schema is not None
            if channel.message_encoding == "json":
                found.append((channel.topic, message.log_time, msgspec.json.decode(message.data)))
            else:
                decode = DecoderFactory().decoder_for(channel.message_encoding, schema)
                assert decode is not None
                found.append((channel.topic, message.log_time, decode(message.data)))
    return found


def test_any_mcap_reader_finds_every_topic_its_schema_and_an_index(tmp_path: Path) -> None:
    path = tmp_path / "walk.mcap"
    messages = walk(1.0)
    record(path, messages)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    topics = {channel.topic for channel in summary.channels.values()}
    assert topics == {
        *("imu", "frame_header", "frame/left", "frame/right", "dropped_frame", "ankle", "tick", "load"),
        *("device_counters", "attitude", "ground", "truth"),
    }
    assert all(chunk.compression == "" for chunk in summary.chunk_indexes)
    found = read_by_others(path)
    frames = sum(isinstance(message, StereoFrame) for message in messages)
    assert len(found) == len(messages) + 2 * frames == summary.statistics.message_count


def test_what_is_written_fits_the_published_json_schema(tmp_path: Path) -> None:
    record(tmp_path / "walk.mcap", walk(0.5))
    checked = set()
    for topic, _, content in read_by_others(tmp_path / "walk.mcap"):
        if topic in TOPICS:
            jsonschema.validate(content, json_schema(TOPICS[topic]))
            checked.add(topic)
    assert len(checked) == 10


def test_images_are_mono8_with_the_time_of_exposure(tmp_path: Path) -> None:
    shot = frame(3, 5_000_000_000)
    record(tmp_path / "frame.mcap", [shot])
    (left_topic, _, left), (right_topic, _, right), (header_topic, _, _) = read_by_others(tmp_path / "frame.mcap")
    assert (left_topic, right_topic, header_topic) == ("frame/left", "frame/right", "frame_header")
    assert (left.encoding, left.width, left.height, left.step) == ("mono8", 32, 20, 32)
    assert (left.timestamp.seconds, left.timestamp.nanos) == (4, 960_000_000)
    assert np.array_equal(np.frombuffer(right.data, np.uint8).reshape(20, 32), shot.right)


def test_log_times_never_run_backwards_so_that_a_viewer_keeps_the_order(tmp_path: Path) -> None:
    record(tmp_path / "walk.mcap", walk(1.0))
    times = [log_time for _, log_time, _ in read_by_others(tmp_path / "walk.mcap")]
    assert times == sorted(times)
    assert times[0] == 10**9


def field_problem(schema: dict[str, Any], where: str) -> str | None:
    """What Foxglove's JSON Schema reader throws on, told from its behaviour; None if it takes the field."""
    if "$ref" in schema or "oneOf" in schema or not isinstance(schema.get("type"), str):
        return f"{where}: type {schema.get('type')}"
    if schema["type"] == "object":
        return next(filter(None, (field_problem(item, name) for name, item in schema["properties"].items())), None)
    if schema["type"] == "array":
        return field_problem(schema["items"], where)
    return None if schema["type"] in ("boolean", "string", "number", "integer") else f"{where}: {schema['type']}"


@pytest.mark.parametrize("topic", [topic for topic in TOPICS.values() if topic.message not in IMAGE_CHANNELS])
def test_the_schemas_in_the_file_use_only_what_foxglove_reads(topic: Any) -> None:
    schema = viewer_schema(topic.message)
    content = msgspec.json.decode(schema.data)
    assert content["type"] == "object"
    assert field_problem(content, topic.name) is None
    assert list(content["properties"]) == [field.name for field in msgspec.structs.fields(topic.message)]


def test_a_ring_begins_with_the_decisions_that_still_hold(tmp_path: Path) -> None:
    second_ns = 1_000_000_000
    recorder = Recorder(tmp_path / "ring.mcap", INFO, last_s=3.0)
    changes = [Reconfigured(t_ns=second_ns, configuration=text) for text in ("first", "second")]
    reduced = LoadLevel(t_ns=2 * second_ns, load=Load.REDUCED)
    later = [Tick(t_ns=k * second_ns) for k in range(3, 20)]
    inputs: list[Input] = [*changes, reduced, *later]
    for message in inputs:
        recorder.offer(message)
    recorder.drain(timeout_s=0.0)
    recorder.close()
    recorded = list(McapRecording(tmp_path / "ring.mcap").inputs())
    assert recorded == [changes[1], reduced, *later[-4:]]
