"""A floor that mirrors lamps: what corners follow of them leads no attitude astray and accuses no eye, and nothing
stands on the floor."""

import pytest

from lab.faults.offline import Judged, OfflineWalk
from messages import Attitude, GroundPlane, Terrain


def walked(unit: int, seconds: float) -> tuple[Judged, int]:
    """Return what the pipeline makes of a unit's walk, and in how many frames it tells of a thing."""
    walk = OfflineWalk(unit, "polished-floor", seconds)
    pipeline, judged, things = walk.new_pipeline(), Judged(), 0
    for message in walk.inputs:
        for told in pipeline.step(message):
            if isinstance(told, Attitude):
                judged.add_attitude(told, walk.wearer)
            elif isinstance(told, GroundPlane):
                judged.add(told, walk.wearer.truth_of(told), 0.0)
            elif isinstance(told, Terrain):
                things += bool(told.obstacles)
    return judged, things


@pytest.mark.long
def test_what_a_floor_mirrors_is_neither_a_turn_nor_a_thing() -> None:
    judged, things = walked(61, 6.0)
    assert judged.wrong == judged.wrong_attitudes == 0
    assert judged.valid > 0.8 * judged.frames
    assert judged.worst_tilt_deg < 0.7  # 1.17 where their errors count as independent
    assert things == 0  # in 25 frames, where what is mirrored is not looked for


@pytest.mark.long
def test_what_a_floor_mirrors_is_no_eye_that_stands_askew() -> None:
    judged, _ = walked(309, 6.0)
    assert judged.wrong == 0
    assert judged.valid > 0.75 * judged.frames  # a fifth where rows and their likeness in a row of frames count as ever
    assert judged.seen.get("eyes_misaligned", 0) == 0
