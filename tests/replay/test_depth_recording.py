"""Depth frames through the recorder and back: the same pixels, and the same estimates to the last byte."""

import dataclasses
from pathlib import Path

import foxglove.messages
import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from calib.files import format_calibration
from daemon.pipeline import Pipeline
from daemon.recorder import Recorder
from daemon.recording_file import Recordable
from daemon.replay import replay
from daemon.replay_source import open_source
from drivers.camera.frame_pool import PixelPool
from drivers.protocols import DeviceError
from drivers.recording.recording import DEPTH_IMAGE, McapRecording
from messages import DepthFrame, DropCause, DroppedFrame, Estimate, GroundPlane, Status
from messages.codec import encode
from perception.ground.foothold import FootholdSettings
from sim_rig.depth_wearer import DepthWearer
from sim_rig.walk.scenario import scenario
from tests.bench.recorded import INFO, all_facts, depth_frame, frame, header, imu, record


def test_depth_frames_come_back_bit_for_bit_in_their_order(tmp_path: Path) -> None:
    sent: list[Recordable] = [imu(0, 1), depth_frame(0, 2), imu(1, 3), depth_frame(1, 4)]
    record(tmp_path / "depth.mcap", sent)
    source = McapRecording(tmp_path / "depth.mcap")
    got = list(source.inputs())
    assert all_facts(got) == all_facts(sent)
    assert source.damage is None
    assert isinstance(got[1], DepthFrame)
    assert got[1].depth.dtype == np.uint16
    assert not got[1].depth.flags.writeable


def test_the_file_holds_what_foxglove_shows_as_depth_in_millimetres(tmp_path: Path) -> None:
    shot = depth_frame(3, 50_000_000)
    record(tmp_path / "depth.mcap", [shot])
    with (tmp_path / "depth.mcap").open("rb") as file:
        [(schema, _, _, image)] = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
            topics=[DEPTH_IMAGE]
        )
    assert schema is not None
    assert schema.name == foxglove.messages.RawImage.get_schema().name
    assert (image.encoding, image.width, image.height, image.step) == ("16UC1", 32, 20, 64)
    np.testing.assert_array_equal(np.frombuffer(image.data, "<u2").reshape(20, 32), shot.depth)


def test_a_full_queue_and_the_ring_treat_depth_frames_as_frames(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "full.mcap", INFO, queue_frames=1, last_s=5.0)
    pool = PixelPool(2, (20, 32), np.uint16)
    for seq in range(2):
        depth = pool.lend()
        assert depth is not None
        depth[:] = seq
        recorder.offer(DepthFrame(header=header(seq, seq), depth=depth))
    del depth
    assert recorder.dropped_by_kind == {"depth_frame": 1}
    assert pool.free == 1
    recorder.drain(timeout_s=0.0)
    assert pool.free == 2
    recorder.offer(depth_frame(2, 2))
    recorder.close()
    kinds = [type(message) for message in McapRecording(tmp_path / "full.mcap").inputs()]
    assert kinds == [DepthFrame, DroppedFrame, DepthFrame]
    lost = list(McapRecording(tmp_path / "full.mcap").inputs())[1]
    assert isinstance(lost, DroppedFrame)
    assert lost.cause is DropCause.NOT_RECORDED


def test_a_depth_frame_of_another_size_than_its_header_is_refused(tmp_path: Path) -> None:
    shot = msgspec.structs.replace(depth_frame(0, 1), depth=depth_frame(0, 1, 30, 20).depth)
    record(tmp_path / "size.mcap", [shot])
    with pytest.raises(DeviceError, match="frame 0 is 30x20 px on channel 'frame/depth', allowed 32x20 px"):
        list(McapRecording(tmp_path / "size.mcap").inputs())


def test_both_kinds_of_frame_may_stand_in_one_file(tmp_path: Path) -> None:
    sent: list[Recordable] = [frame(0, 1), depth_frame(1, 2), frame(2, 3)]
    record(tmp_path / "both.mcap", sent)
    assert all_facts(list(McapRecording(tmp_path / "both.mcap").inputs())) == all_facts(sent)


def test_a_replayed_depth_walk_gives_the_same_bytes(tmp_path: Path) -> None:
    wearer = DepthWearer(5, scenario("standing"), 10_000_000_000)
    info = dataclasses.replace(
        INFO, calibration_text=format_calibration(wearer.calibration), configuration_text="device = 'bench'\n"
    )
    recorder = Recorder(tmp_path / "walk.mcap", info)
    live: list[Estimate] = []
    pipeline = Pipeline(wearer.calibration, FootholdSettings())
    for message in wearer.offline_inputs(1.8):
        recorder.offer(message)
        live += pipeline.step(message)
        recorder.drain(timeout_s=0.0)
    recorder.close()
    assert any(isinstance(estimate, GroundPlane) and estimate.status is Status.VALID for estimate in live)

    source = open_source(tmp_path / "walk.mcap", None)
    assert source.calibration == wearer.calibration
    again = Pipeline(source.calibration, source.configuration.foothold)
    replayed = [estimate for message in source.inputs() for estimate in again.step(message)]
    assert [encode(estimate) for estimate in replayed] == [encode(estimate) for estimate in live]
    told = replay(source.inputs(), Pipeline(source.calibration, source.configuration.foothold), None)
    assert len(told.grounds) == sum(isinstance(estimate, GroundPlane) for estimate in live)
