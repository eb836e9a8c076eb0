"""A walk through the whole pipeline with something before one eye: no plane that is wrong is valid."""

import msgspec
import numpy as np
import pytest

from daemon.pipeline import Pipeline
from lab.faults import deformed_view
from lab.faults.criteria import errors_of
from lab.faults.faulty_camera import ImageChange
from messages import GroundPlane, Health, Input, Reason, Status, StereoFrame
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


def walked(
    wearer: SimulatedWearer, inputs: list[Input], change: ImageChange | None
) -> tuple[list[GroundPlane], list[Health]]:
    """Return the grounds from the onset on, and the healths."""
    pipeline = Pipeline(wearer.calibration, FootholdSettings())
    grounds: list[GroundPlane] = []
    healths: list[Health] = []
    for message in inputs:
        if change is not None and isinstance(message, StereoFrame) and message.header.t_exposure_ns >= ONSET_NS:
            left, right = change((message.left, message.right))
            message = msgspec.structs.replace(message, left=left, right=right)
        for told in pipeline.step(message):
            if isinstance(told, GroundPlane) and told.t_exposure_ns >= ONSET_NS:
                grounds.append(told)
            elif isinstance(told, Health):
                healths.append(told)
    return grounds, healths


def wrong(grounds: list[GroundPlane], wearer: SimulatedWearer) -> int:
    valid = [ground for ground in grounds if ground.status is Status.VALID]
    return sum(errors_of(ground, wearer.truth_of(ground)).wrong for ground in valid)


def test_a_sound_view_is_valid_throughout(wearer: SimulatedWearer, inputs: list[Input]) -> None:
    grounds, _ = walked(wearer, inputs, None)
    assert all(ground.status is Status.VALID for ground in grounds)


@pytest.mark.parametrize(("most_px", "left"), [(1.0, True), (3.0, False)])
def test_a_drop_on_the_lens_is_noticed_before_a_wrong_plane_is_valid(
    wearer: SimulatedWearer, inputs: list[Input], most_px: float, left: bool
) -> None:
    drop = deformed_view.drop(np.random.default_rng(5)).of_size(most_px)
    grounds, healths = walked(wearer, inputs, deformed_view.warped(drop, left=left))
    assert wrong(grounds, wearer) == 0
    reasons = [ground.reason for ground in grounds]
    assert Reason.VIEW_DEFORMED in reasons[:12]
    assert reasons[-1] is Reason.VIEW_DEFORMED
    assert healths[-1].refused[Reason.VIEW_DEFORMED] > 0


@pytest.mark.parametrize("turn", ["mirrored", "upside_down", "turned_round"])
def test_pictures_that_turn_over_in_mid_walk_are_never_valid(
    wearer: SimulatedWearer, inputs: list[Input], turn: str
) -> None:
    grounds, _ = walked(wearer, inputs, getattr(deformed_view, turn))
    assert not any(ground.status is Status.VALID for ground in grounds[1:])


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "seed", "seconds"),
    [("half-covered", 1, 6.0), ("half-covered", 7, 6.0), ("blur-9", 8, 9.5), ("camera-turned-15", 11, 5.0)],
)
def test_what_covers_blurs_or_turns_the_view_leaves_no_plane_of_chance(name: str, seed: int, seconds: float) -> None:
    grounds, _, wearer = told_since(name, seed, seconds)
    assert len(grounds) > 20
    assert wrong(grounds, wearer) == 0
