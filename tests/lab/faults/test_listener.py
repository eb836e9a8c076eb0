"""A ground of CAN, which tells neither its place nor its exact exposure, is held against the same one on Zenoh; and
each daemon that is heard has numbers of its own."""

import json
import time

import zenoh

from lab.faults.criteria import Errors
from lab.faults.daemon_process import DEVICE
from lab.faults.listener import Heard, Listener, heard_at, heard_of
from messages import TOPICS, GroundTruth
from messages.can_encoder import CanEncoder
from messages.can_estimates import ReceivedGround
from messages.can_receiver import CanReceiver
from messages.codec import encode_line
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer
from tests.bench.can_samples import ground, stamp
from tests.bench.zenoh_peer import PATIENCE_POLLS, POLL_S, free_endpoint

FRAME_NS, MS = 50_000_000, 1_000_000
TRUTH = GroundTruth(
    t_exposure_ns=0,
    slope_sagittal_rad=0.0,
    slope_frontal_rad=0.0,
    height_m=0.9,
    q_WB=(1.0, 0.0, 0.0, 0.0),
    kind="level",
    transition=False,
    standing=False,
)


def heard(count: int) -> list[Heard]:
    return [
        Heard(k * FRAME_NS, ground(t_exposure_ns=k * FRAME_NS), TRUTH, Errors(0.0, 0.0, False), True, False, False)
        for k in range(count)
    ]


def test_frames_that_come_late_are_those_of_the_nearest_exposure() -> None:
    grounds = heard(12)
    for late_ns in (0, MS, 12 * MS, 24 * MS):
        found = heard_at(grounds, 10 * FRAME_NS + late_ns)
        assert found is not None
        assert found.ground.t_exposure_ns == 10 * FRAME_NS


def test_a_ground_that_zenoh_did_not_bring_is_none_of_the_others() -> None:
    grounds = heard(12)
    assert heard_at([], 0) is None
    assert heard_at([each for each in grounds if each.t_ns != 10 * FRAME_NS], 10 * FRAME_NS) is None
    assert heard_at(grounds, 12 * FRAME_NS + 26 * MS) is None


def received(height_m: float) -> ReceivedGround:
    """Return a ground as CAN carries it: the second, for of the first the counter tells nothing."""
    encoder, receiver = CanEncoder(), CanReceiver(ReceivedGround, max_age_s=0.15)
    found = None
    for t_ns in (FRAME_NS, 2 * FRAME_NS):
        of_frame = ground(t_exposure_ns=t_ns - 40 * MS, height_m=height_m)
        for frame in encoder.ground(of_frame, stamp(t_publish_ns=t_ns), 0.04):
            found = receiver.feed(frame.can_id, frame.data, t_ns)
    assert isinstance(found, ReceivedGround), found
    return found


def test_a_ground_that_comes_a_frame_late_on_can_is_known_by_its_numbers() -> None:
    heights_m = [0.8004 + 0.01 * k for k in range(12)]
    grounds = [
        each._replace(ground=ground(t_exposure_ns=each.t_ns, height_m=height_m))
        for each, height_m in zip(heard(12), heights_m, strict=True)
    ]
    found = heard_of(grounds, received(heights_m[9]))
    assert found is not None
    assert found.t_ns == 9 * FRAME_NS
    assert heard_of(grounds, received(heights_m[9] + 0.005)) is None
    assert heard_of([each._replace(valid=False) for each in grounds], received(heights_m[9])) is None


def put_until_heard(endpoint: str, listener: Listener, seq: int, *, take: bool) -> None:
    """Be a daemon that tells one ground, as often as it takes until the listener has it, and `take`s it or not."""
    how = {
        "mode": "peer",
        "listen": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}},
    }
    with zenoh.open(zenoh.Config.from_json5(json.dumps(how))) as session:
        listener.connect(endpoint)
        publisher = session.declare_publisher(TOPICS["ground"].key(DEVICE))
        for _ in range(PATIENCE_POLLS):
            if publisher.matching_status.matching:
                break
            time.sleep(POLL_S)
        now_ns = time.monotonic_ns()
        publisher.put(encode_line(TOPICS["ground"], ground(t_exposure_ns=now_ns), stamp(seq=seq, t_publish_ns=now_ns)))
        heard = listener.heard
        for _ in range(PATIENCE_POLLS if take else 0):
            listener.take()
            if listener.heard > heard:
                break
            time.sleep(POLL_S)
        else:
            time.sleep(100 * POLL_S)  # it waits to be taken by then
        listener.close()


def test_what_waits_of_the_daemon_before_makes_no_number_of_the_next_a_repeated_one() -> None:
    wearer = SimulatedWearer(1, scenario("standing"), time.monotonic_ns())
    listener = Listener(wearer)
    put_until_heard(free_endpoint(), listener, seq=7, take=False)
    put_until_heard(free_endpoint(), listener, seq=7, take=True)
    assert [heard.stale for heard in listener.grounds] == [False, False]
