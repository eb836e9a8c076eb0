"""What is too old loses its numbers on the way out; a recording keeps what the pipeline said."""

import math
from pathlib import Path

import msgspec
import pytest
from mcap.reader import make_reader

from daemon.latency import LatencyLog
from daemon.outgoing import STALE_NS, Outgoing, withdrawn_if_late
from daemon.recorder import Recorder, RecordingInfo
from daemon.stamping import Stamper
from messages import (
    Attitude,
    Estimate,
    FrameHeader,
    GroundPlane,
    Motion,
    PropagatedGround,
    Reason,
    Source,
    Stamp,
    Status,
    Terrain,
    capture_ns,
)
from messages.codec import decode
from perception.ground.propagation import OLDEST_PICTURE_NS
from tests.bench.can_samples import attitude, ground, health, invalid_ground, motion, propagated_ground, terrain


class Listener:
    def __init__(self, name: str = "zenoh", errors: int = 0) -> None:
        self.name, self.errors = name, errors
        self.heard: list[Estimate] = []
        self.closed = False

    def publish(self, estimate: Estimate, stamp: Stamp) -> None:  # noqa: ARG002
        self.heard.append(estimate)

    def close(self) -> None:
        self.closed = True


@pytest.mark.parametrize("estimate", [ground(), attitude(), motion(), terrain()])
def test_what_is_too_old_is_late_and_has_no_numbers(estimate: GroundPlane | Attitude | Motion | Terrain) -> None:
    limit_ns = capture_ns(estimate) + STALE_NS
    assert withdrawn_if_late(estimate, limit_ns) is estimate
    late = withdrawn_if_late(estimate, limit_ns + 1)
    assert isinstance(late, GroundPlane | Attitude | Motion | Terrain)
    assert (late.status, late.reason) == (Status.INVALID, Reason.LATE)
    assert capture_ns(late) == capture_ns(estimate)
    said = msgspec.structs.asdict(late)
    assert said.get("edges", ()) == ()
    for name in ("slope_sagittal_rad", "slope_frontal_rad", "height_m", "distance_m", "distance_var_m2", "probability"):
        assert name not in said or math.isnan(said[name])
    vectors = ("covariance", "q_WB", "w_WB_B_radps", "gyro_bias_B_radps", "rotation_cov_W_rad2")
    for name in (*vectors, "velocity_H_mps", "rate_H_radps", "velocity_cov_H", "rate_cov_H"):
        assert all(math.isnan(value) for value in said.get(name, ()))


def test_a_ground_is_carried_until_its_picture_is_too_old() -> None:
    carried = propagated_ground(picture_age_s=0.06)
    limit_ns = carried.t_sample_ns - 60_000_000 + OLDEST_PICTURE_NS
    assert withdrawn_if_late(carried, limit_ns) is carried
    late = withdrawn_if_late(carried, limit_ns + 1)
    assert isinstance(late, PropagatedGround)
    assert (late.status, late.reason, late.t_sample_ns) == (Status.INVALID, Reason.LATE, carried.t_sample_ns)
    assert all(map(math.isnan, (late.height_m, late.picture_age_s, *late.covariance)))


@pytest.mark.parametrize("estimate", [health(), invalid_ground()])
def test_what_has_no_numbers_stays_as_it_is(estimate: Estimate) -> None:
    assert withdrawn_if_late(estimate, 10**15) is estimate


def test_a_late_plane_is_published_as_late_and_recorded_as_computed(tmp_path: Path) -> None:
    info = RecordingInfo(device="t", source=Source.LIVE, calibration_text="", configuration_text="")
    recorder = Recorder(tmp_path / "r.mcap", info)
    listener, observed = Listener(), list[Estimate]()

    def observe(estimate: Estimate, _header: FrameHeader | None) -> None:
        observed.append(estimate)

    outgoing = Outgoing([listener], Stamper("t", "boot", Source.LIVE), recorder, [observe])
    computed = ground()
    outgoing.send(computed, 0, lambda: capture_ns(computed) + 2 * STALE_NS, LatencyLog())
    recorder.close()
    with (tmp_path / "r.mcap").open("rb") as file:
        recorded = [decode(m.data, GroundPlane) for _, _, m in make_reader(file).iter_messages(topics=["ground"])]
    assert recorded == [computed]
    assert [e.reason for e in (*listener.heard, *observed) if isinstance(e, GroundPlane)] == [Reason.LATE] * 2
    assert outgoing.withdrawn == 1


def test_every_publisher_is_sent_to_counted_and_closed() -> None:
    zenoh, can = Listener(errors=3), Listener("can", errors=5)
    outgoing = Outgoing([zenoh, can], Stamper("t", "boot", Source.LIVE), None, [])
    assert (outgoing.errors("zenoh"), outgoing.errors("can")) == (3, 5)
    outgoing.send(health(), 0, lambda: 0, LatencyLog())
    assert (len(zenoh.heard), len(can.heard)) == (1, 1)
    outgoing.close()
    assert (zenoh.closed, can.closed) == (True, True)
