"""A ground of CAN, which tells neither its place nor its exact exposure, is held against the same one on Zenoh."""

from lab.faults.criteria import Errors
from lab.faults.listener import Heard, heard_at
from messages import GroundTruth
from tests.bench.can_samples import ground

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
