"""Pictures whose lower half is a frame late: their corners move as the camera did a step before."""

import numpy as np
import pytest

from lab.faults import image_changes
from lab.faults.criteria import errors_of
from lab.faults.offline import FOR_EVER_NS, START_NS, OfflineWalk, Strike, pictures, struck
from messages import GroundPlane, Reason, Status, StereoFrame
from perception.motion.torn import Torn

TORN_NS = START_NS + 3_500_000_000


def shares(off_px: list[float], off_before_px: list[float], steps: int) -> list[bool]:
    torn = Torn()
    found = []
    for _ in range(steps):
        torn.add(np.array(off_px), np.array(off_before_px))
        found.append(torn.contradicts)
    return found


def test_corners_that_are_a_step_late_contradict_and_others_do_not() -> None:
    late, agreeing = ([5.0, 5.0], [0.3, 0.2]), ([0.1] * 8, [5.0] * 8)
    assert shares(late[0] + agreeing[0], late[1] + agreeing[1], 2)[-1]
    of_another_body = [5.0, 5.0], [4.0, 3.0]
    assert not any(shares(of_another_body[0] + agreeing[0], of_another_body[1] + agreeing[1], 20))
    barely_off = [0.9, 0.9], [0.0, 0.0]
    assert not any(shares(barely_off[0] + agreeing[0], barely_off[1] + agreeing[1], 20))


def test_what_contradicted_is_forgotten_within_half_a_second() -> None:
    torn = Torn()
    for _ in range(8):
        torn.add(np.full(10, 5.0), np.array([0.1] * 4 + [5.0] * 6))
    assert torn.contradicts
    for _ in range(10):
        torn.add(np.full(10, 0.1), np.full(10, 5.0))
    assert not torn.contradicts


@pytest.mark.parametrize("every", [1, 2], ids=["20 a second", "10 a second"])
def test_no_ground_of_torn_pictures_is_wrong_and_valid(every: int) -> None:
    walk = OfflineWalk(13, "ramps", 6.0)
    pipeline, reasons, wrong = walk.new_pipeline(), list[Reason](), 0
    shown = [m for m in walk.inputs if not isinstance(m, StereoFrame) or m.header.seq % every == 0]
    for message in struck(shown, [Strike(pictures(image_changes.torn()), TORN_NS, FOR_EVER_NS)]):
        for told in pipeline.step(message):
            if isinstance(told, GroundPlane) and told.frame_seq >= 0 and told.t_exposure_ns < TORN_NS:
                assert told.reason is not Reason.TIME_INCONSISTENT
            elif isinstance(told, GroundPlane) and told.frame_seq >= 0:
                reasons.append(told.reason)
                wrong += told.status is Status.VALID and errors_of(told, walk.wearer.truth_of(told)).wrong
    assert wrong == 0
    assert reasons.count(Reason.TIME_INCONSISTENT) > 0.3 * len(reasons)
