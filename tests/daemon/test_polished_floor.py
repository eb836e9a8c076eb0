"""A floor that mirrors lamps: what corners follow of them leads no attitude astray, and nothing stands on the floor."""

import pytest

from lab.faults.offline import Judged, OfflineWalk
from messages import Attitude, GroundPlane, Terrain

UNIT, SECONDS = 61, 6.0


@pytest.mark.long
def test_what_a_floor_mirrors_is_neither_a_turn_nor_a_thing() -> None:
    walk = OfflineWalk(UNIT, "polished-floor", SECONDS)
    pipeline, judged, things, frames = walk.new_pipeline(), Judged(), 0, 0
    for message in walk.inputs:
        for told in pipeline.step(message):
            if isinstance(told, Attitude):
                judged.add_attitude(told, walk.wearer)
            elif isinstance(told, GroundPlane):
                judged.add(told, walk.wearer.truth_of(told), 0.0)
            elif isinstance(told, Terrain):
                things += bool(told.obstacles)
                frames += 1
    assert judged.wrong == judged.wrong_attitudes == 0
    assert judged.valid > 0.8 * frames
    assert judged.worst_tilt_deg < 0.7  # 1.17 where their errors count as independent
    assert things == 0  # in 25 frames, where what is mirrored is not looked for
