"""A walk through the whole pipeline with something before one eye: no plane that is wrong is valid."""

import msgspec
import numpy as np
import pytest

from daemon.pipeline import Pipeline
from lab.faults import deformed_view
from lab.faults.criteria import errors_of
from lab.faults.faulty_camera import ImageChange
from lab.faults.message_faults import KINDS
from lab.faults.offline import FOR_EVER_NS, Judged, OfflineWalk, Strike, pictures, struck
from messages import Attitude, Estimate, GroundPlane, Health, Input, Reason, Status, StereoFrame, Terrain
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer
from tests.daemon.struck_walks import told_since

START_NS, ONSET_NS = 10_000_000_000, 12_600_000_000


@pytest.fixture(scope="module")
def wearer() -> SimulatedWearer:
    return SimulatedWearer(2, scenario("level"), START_NS)


@pytest.fixture(scope="module")
def inputs(wearer: SimulatedWearer) -> list[Input]:
    return list(wearer.offline_inputs(4.0))


@pytest.fixture(scope="module", params=[(1.0, True), (3.0, False)], ids=["1 px, left", "3 px, right"])
def behind_a_drop(wearer: SimulatedWearer, inputs: list[Input], request: pytest.FixtureRequest) -> list[Estimate]:
    """What is told of the walk with a drop on one lens that moves the picture by so much."""
    most_px, left = request.param
    drop = deformed_view.drop(np.random.default_rng(5)).of_size(most_px)
    return walked(wearer, inputs, deformed_view.warped(drop, left=left))


def walked(wearer: SimulatedWearer, inputs: list[Input], change: ImageChange | None) -> list[Estimate]:
    """Return what is told of the walk whose pictures are changed from the onset on."""
    pipeline = Pipeline(wearer.calibration, FootholdSettings())
    told: list[Estimate] = []
    for message in inputs:
        if change is not None and isinstance(message, StereoFrame) and message.header.t_exposure_ns >= ONSET_NS:
            left, right = change((message.left, message.right))
            message = msgspec.structs.replace(message, left=left, right=right)
        told += pipeline.step(message)
    return told


def since_onset(told: list[Estimate]) -> list[GroundPlane]:
    return [each for each in told if isinstance(each, GroundPlane) and each.t_exposure_ns >= ONSET_NS]


def wrong(grounds: list[GroundPlane], wearer: SimulatedWearer) -> int:
    valid = [ground for ground in grounds if ground.status is Status.VALID]
    return sum(errors_of(ground, wearer.truth_of(ground)).wrong for ground in valid)


def test_a_sound_view_is_valid_throughout(wearer: SimulatedWearer, inputs: list[Input]) -> None:
    grounds = since_onset(walked(wearer, inputs, None))
    assert len(grounds) > 20
    assert all(ground.status is Status.VALID for ground in grounds)


def test_a_drop_on_the_lens_is_noticed_before_a_wrong_plane_is_valid(
    wearer: SimulatedWearer, behind_a_drop: list[Estimate]
) -> None:
    grounds = since_onset(behind_a_drop)
    assert wrong(grounds, wearer) == 0
    reasons = [ground.reason for ground in grounds]
    assert Reason.VIEW_DEFORMED in reasons[:12]
    assert reasons[-1] is Reason.VIEW_DEFORMED
    health = [each for each in behind_a_drop if isinstance(each, Health)][-1]
    assert health.refused[Reason.VIEW_DEFORMED] > 0


def test_no_terrain_of_a_deformed_view_is_valid(behind_a_drop: list[Estimate]) -> None:
    deformed_ns = {each.t_exposure_ns for each in since_onset(behind_a_drop) if each.reason is Reason.VIEW_DEFORMED}
    terrains = [each for each in behind_a_drop if isinstance(each, Terrain) and each.t_exposure_ns in deformed_ns]
    assert len(terrains) > 3
    assert {(each.status, each.reason) for each in terrains} == {(Status.INVALID, Reason.VIEW_DEFORMED)}


@pytest.mark.parametrize("turn", ["mirrored", "upside_down", "turned_round"])
def test_pictures_that_turn_over_in_mid_walk_are_never_valid(
    wearer: SimulatedWearer, inputs: list[Input], turn: str
) -> None:
    grounds = since_onset(walked(wearer, inputs, getattr(deformed_view, turn)))
    assert not any(ground.status is Status.VALID for ground in grounds[1:])


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "seed", "seconds"),
    [("half-covered", 1, 6.0), ("half-covered", 7, 6.0), ("blur-9", 8, 9.5), ("camera-turned-15", 11, 5.0)],
)
def test_what_covers_blurs_or_turns_the_view_leaves_no_plane_of_chance(name: str, seed: int, seconds: float) -> None:
    """With an eye blurred by 9 px one frame at the foot of a ramp is wrong on three units of twelve; none elsewhere."""
    grounds, _, wearer = told_since(name, seed, seconds)
    assert len(grounds) > 20
    at_edge, elsewhere = list[GroundPlane](), list[GroundPlane]()
    for ground in grounds:
        (at_edge if wearer.truth_of(ground).transition else elsewhere).append(ground)
    assert wrong(elsewhere, wearer) == 0
    assert wrong(at_edge, wearer) <= (1 if name == "blur-9" else 0)


@pytest.fixture(scope="module")
def walk_of_unit_24() -> OfflineWalk:
    return OfflineWalk(24, "level", 8.0)


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "size", "reason"),
    [("toed", "0.8", "eyes_misaligned"), ("rolled", "0.8", "eyes_misaligned"), ("bent", "2", "view_deformed")],
)
def test_an_eye_that_stands_askew_or_behind_a_bent_window_spoils_no_attitude(
    walk_of_unit_24: OfflineWalk, kind: str, size: str, reason: str
) -> None:
    """What such eyes see of a walk is a turn and a ground that moves: believed, it spoils the vertical by 5°."""
    walk, chance = walk_of_unit_24, np.random.default_rng([24, 18])
    change, _ = deformed_view.drawn(kind, size, chance, walk.wearer.unit.stereo)
    pipeline, judged = walk.new_pipeline(), Judged()
    for message in struck(walk.inputs, [Strike(pictures(change), START_NS, FOR_EVER_NS)]):
        for told in pipeline.step(message):
            if isinstance(told, Attitude):
                judged.add_attitude(told, walk.wearer)
            if isinstance(told, GroundPlane) and told.frame_seq >= 0:
                judged.add(told, walk.wearer.truth_of(told), 0.0)
    assert judged.attitudes > 500
    assert judged.wrong_attitudes == 0
    assert judged.worst_tilt_deg < 1.5
    assert judged.seen.get(reason, 0) > 100
    assert judged.wrong == 0


@pytest.fixture(scope="module")
def walk_of_unit_3() -> OfflineWalk:
    return OfflineWalk(3, "level", 8.0)


@pytest.mark.long
@pytest.mark.parametrize("size", ["1", "2"])
def test_a_window_that_stretches_the_view_along_the_rows_is_told_from_the_start(
    walk_of_unit_3: OfflineWalk, size: str
) -> None:
    """Nothing that two eyes see contradicts it, and it stays: only how the ground moves does."""
    walk = walk_of_unit_3
    change, _ = deformed_view.drawn("stretched", size, np.random.default_rng(3), walk.wearer.unit.stereo)
    pipeline, grounds = walk.new_pipeline(), list[GroundPlane]()
    for message in struck(walk.inputs, [Strike(pictures(change), START_NS, FOR_EVER_NS)]):
        grounds += [told for told in pipeline.step(message) if isinstance(told, GroundPlane)]
    walking = [ground for ground in grounds if ground.t_exposure_ns > START_NS + 4_000_000_000]
    assert {ground.reason for ground in walking} == {Reason.DISTANCES_WRONG}


@pytest.mark.long
def test_distances_that_seem_to_jump_as_a_late_eye_is_in_time_again_are_right_again_within_seconds() -> None:
    walk = OfflineWalk(5, "mixed", 14.0)
    from_ns, until_ns = START_NS + 6_000_000_000, START_NS + 8_800_000_000
    late = KINDS["right-late"].draw(np.random.default_rng(5), walk.wearer.unit.stereo)
    pipeline, grounds = walk.new_pipeline(), list[GroundPlane]()
    for message in struck(walk.inputs, [Strike(late, from_ns, until_ns)]):
        grounds += [told for told in pipeline.step(message) if isinstance(told, GroundPlane) and told.frame_seq >= 0]
    assert Reason.DISTANCES_WRONG in {ground.reason for ground in grounds if ground.t_exposure_ns >= until_ns}
    last = [ground for ground in grounds if ground.t_exposure_ns >= until_ns + 4_000_000_000]
    assert sum(ground.status is Status.VALID for ground in last) > 0.9 * len(last)
    assert wrong(grounds, walk.wearer) == 0


@pytest.mark.long
def test_a_sound_view_after_seconds_of_darkness_is_not_called_deformed() -> None:
    """Meanwhile the IMU's velocity has drifted to metres a second, whose flow would show between the eyes' rows."""
    walk, chance = OfflineWalk(1, "ramps", 9.5), np.random.default_rng(1)
    dark_ns, light_ns = START_NS + 3_500_000_000, START_NS + 7_500_000_000
    stereo = walk.wearer.unit.stereo
    strikes = [Strike(KINDS[name].draw(chance, stereo), dark_ns, light_ns) for name in ("black", "gyro-step-5")]
    pipeline, judged = walk.new_pipeline(), Judged()
    last: GroundPlane | None = None
    for message in struck(walk.inputs, strikes):
        for told in pipeline.step(message):
            if isinstance(told, GroundPlane) and told.frame_seq >= 0 and told.t_exposure_ns >= light_ns:
                judged.add(told, walk.wearer.truth_of(told), 0.0)
                last = told
    assert "view_deformed" not in judged.seen
    assert judged.wrong == 0
    assert last is not None
    assert last.status is Status.VALID
