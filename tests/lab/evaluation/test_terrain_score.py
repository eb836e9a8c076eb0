"""Figures of the ground ahead on walks made up by hand, where each of them can be counted."""

import dataclasses
import math

import pytest

from lab.evaluation import terrain_score
from lab.evaluation.terrain_said import Edge, Foothold, Terrain
from lab.evaluation.terrain_score import JudgedFrame, confusion, false_edges, matched, mean_recall, score
from lab.faults import criteria
from sim_rig.walk.terrain_truth import EdgeTruth, SurfaceTruth, TerrainTruth
from sim_rig.walk.truth import FootholdTruth

FRAME_NS, SPEED_MPS = 50_000_000, 1.0
SURFACE = SurfaceTruth(0.95, 0.0, 0.0, math.inf)
FOOT = Foothold(0.7, 0.1, 0.95, 0.01, 0.0, 0.01, 0.0, 0.01, math.nan)


def edge(
    x_m: float, rise_m: float, here_m: float, *, toe_s: float, contact_s: float, visible: float = 1.0
) -> EdgeTruth:
    return EdgeTruth(x_m - here_m, rise_m, 0.0, visible, x_m, round(1e9 * toe_s), round(1e9 * contact_s))


def truth(k: int, kind: str = "level", **changed: object) -> TerrainTruth:
    x_m, t_ns = SPEED_MPS * 0.05 * k, FRAME_NS * k
    plain = TerrainTruth(t_ns + 7, t_ns, kind, (), None, None, x_m, 1.0)
    return dataclasses.replace(plain, **changed)  # type: ignore[arg-type]


def kerb_walk(
    rise_m: float, said_from: int, said_to: int = 100, *, off_m: float = 0.0, bound: bool = False
) -> list[JudgedFrame]:
    """Return 60 frames up to an edge at 3.21 m, said in some: the toe is near after 2 s, the contact 0.8 s later."""
    frames = []
    for k in range(60):
        true = edge(3.21, rise_m, 0.05 * k, toe_s=2.0, contact_s=2.8, visible=0.5)
        said = Edge(true.distance_m + off_m, 0.01, rise_m + off_m, 0.01, bound)
        edges = (said,) if said_from <= k <= said_to else ()
        frames.append(JudgedFrame(truth(k, edges=(true,)), Terrain(FRAME_NS * k + 7, "level", edges, None)))
    return frames


@pytest.mark.parametrize(("rise_m", "way"), [(0.15, "up"), (-0.15, "down")])
@pytest.mark.parametrize(
    ("said_from", "said_to", "known"), [(10, 100, 1), (39, 100, 1), (40, 100, 0), (10, 35, 0), (10, 36, 1)]
)
def test_an_edge_counts_where_it_is_said_just_before_the_instant(
    rise_m: float, way: str, said_from: int, said_to: int, known: int
) -> None:
    counts = getattr(score(kerb_walk(rise_m, said_from, said_to), plain=False), way)
    assert (counts.edges, counts.in_time) == (1, known)  # the toe is near when it is 0.8 s to the contact
    assert (counts.transitions, counts.known) == (1, known)


def test_an_edge_the_other_way_or_too_far_off_is_another() -> None:
    frames = kerb_walk(0.15, 0, off_m=0.13)
    assert score(frames, plain=False).up.in_time == 0
    assert score(kerb_walk(0.15, 0, off_m=0.11), plain=False).up.in_time == 1
    true = frames[0].truth.edges[0]
    wrong_way = Terrain(7, "level", (Edge(true.distance_m, 0.01, -0.15, 0.01),), None)
    assert matched(JudgedFrame(frames[0].truth, wrong_way)) == {}


def test_each_edge_said_stands_for_one_true_edge_the_nearest() -> None:
    edges = tuple(edge(x, 0.15, 0.0, toe_s=9, contact_s=9) for x in (0.80, 0.92))
    said = (Edge(0.85, 0.01, 0.15, 0.01), Edge(0.90, 0.01, 0.16, 0.01))
    found = matched(JudgedFrame(truth(0, edges=edges), Terrain(7, "level", said, None)))
    assert found == {0.92: said[1], 0.80: said[0]}


def test_a_riser_that_was_never_in_view_is_not_counted_a_lip_is() -> None:
    for rise_m, way, edges, unseen in ((0.15, "up", 0, 1), (-0.15, "down", 1, 0)):
        frames = [
            dataclasses.replace(
                f, truth=dataclasses.replace(f.truth, edges=(dataclasses.replace(f.truth.edges[0], visible=0.0),))
            )
            for f in kerb_walk(rise_m, 0)
        ]
        counts = getattr(score(frames, plain=False), way)
        assert (counts.edges, counts.unseen) == (edges, unseen)


def test_errors_of_rises_and_distances_are_those_said() -> None:
    up = score(kerb_walk(0.15, 0, off_m=0.01), plain=False)
    assert up.rise_up_m == pytest.approx([0.01] * 60)
    assert up.distance_up_m == pytest.approx([0.01] * 4)  # the edge is 0.9 to 1.1 m away in frames 43 to 46
    assert up.rise_down_m == up.distance_down_m == []
    down = score(kerb_walk(-0.15, 0, off_m=0.01), plain=False)
    assert down.rise_down_m == pytest.approx([0.01] * 60)
    hidden = [
        dataclasses.replace(
            f, truth=dataclasses.replace(f.truth, edges=(dataclasses.replace(f.truth.edges[0], visible=0.05),))
        )
        for f in kerb_walk(-0.15, 0)
    ]
    assert score(hidden, plain=False).rise_down_m == []


@pytest.mark.parametrize(("off_m", "holds"), [(0.1, 60), (0.0, 60), (-0.009, 60), (-0.02, 0)])
def test_a_bound_holds_where_the_ground_falls_by_no_less(off_m: float, holds: int) -> None:
    found = score(kerb_walk(-0.15, 0, off_m=off_m, bound=True), plain=False)
    assert (found.bounds, found.bounds_hold) == (60, holds)
    assert found.rise_down_m == []


def test_false_edges_are_counted_once_for_as_long_as_they_last() -> None:
    def said(k: int, *at_x_m: float) -> JudgedFrame:
        edges = tuple(Edge(x - 0.05 * k, 0.01, 0.1, 0.01) for x in at_x_m)
        return JudgedFrame(truth(k), Terrain(7, "level", edges, None))

    frames = [said(k, 2.0) if k < 10 else said(k) for k in range(40)]
    assert false_edges(frames) == 1
    frames[12] = said(12, 2.05)
    assert false_edges(frames) == 1
    frames[30] = said(30, 2.05)  # after more than half a second it is another
    assert false_edges(frames) == 2
    frames[31] = said(31, 2.05, 2.6)
    assert false_edges(frames) == 3
    found = score(frames, plain=True)
    assert found.plain_m == pytest.approx(39 * 0.05)
    assert found.false_edges == 3
    true = edge(2.0, -0.1, 0.0, toe_s=9, contact_s=9)
    assert false_edges([JudgedFrame(truth(0, edges=(true,)), frames[0].said)]) == 0


def test_two_frames_on_either_side_of_a_change_of_kind_are_left_out() -> None:
    kinds = ["level"] * 10 + ["step_up"] * 6 + ["level"] * 5
    frames = [JudgedFrame(truth(k, kind), Terrain(7, "level", (), None)) for k, kind in enumerate(kinds)]
    frames[0] = JudgedFrame(frames[0].truth, None)
    counts = confusion(frames)
    assert counts == {"level>none": 1, "level>level": 7 + 3, "step_up>level": 2}
    assert mean_recall(counts) == pytest.approx(0.5 * 10 / 11)
    assert math.isnan(mean_recall({}))


def landing(t_s: float) -> FootholdTruth:
    return FootholdTruth(round(1e9 * t_s), True, 0.6, 0.1, 0.95, 0.0, 0.0, 0.0, "level")


def test_a_landing_is_judged_in_the_last_frame_a_quarter_of_a_second_before() -> None:
    frames = []
    for k in range(20):
        said = dataclasses.replace(FOOT, ahead_m=0.6 + 0.01 * k, time_to_contact_s=1.0 - 0.05 * k)
        frames.append(
            JudgedFrame(truth(k, foothold=landing(0.98), surface=SURFACE), Terrain(7, "level", (), said), SURFACE)
        )
    found = score(frames, plain=False)
    assert found.landings == 1  # 0.98 − 0.25 s: frame 14, at 0.70 s
    assert found.landing_ahead_m == pytest.approx([0.14])
    assert found.landing_left_m == pytest.approx([0.0])
    assert found.landing_s == pytest.approx([1.0 - 0.70 - 0.28])
    assert score(frames[:10], plain=False).landings == 0


@pytest.mark.parametrize(
    ("height_m", "sd_m", "slope_rad", "wrong"),
    [(0.96, 0.01, 0.0, 0), (1.0, 0.01, 0.0, 1), (1.0, 0.013, 0.0, 0), (0.95, 0.01, 0.06, 1), (0.95, math.nan, 0.0, 1)],
)
def test_wrong_is_beyond_the_bound_and_four_deviations(
    height_m: float, sd_m: float, slope_rad: float, wrong: int
) -> None:
    said = dataclasses.replace(FOOT, height_m=height_m, height_sd_m=sd_m, slope_sagittal_rad=slope_rad)
    near = dataclasses.replace(SURFACE, from_edge_m=0.2)
    frame = JudgedFrame(truth(0, foothold=landing(0.5), surface=near), Terrain(7, "level", (), said), near)
    found = score([frame], plain=False)
    assert (found.valid, found.wrong, found.near_frames) == (1, wrong, 1)
    assert found.near[0].error_m == pytest.approx(height_m - 0.95)
    on_edge = dataclasses.replace(near, from_edge_m=0.01)
    assert score([dataclasses.replace(frame, under=on_edge)], plain=False).valid == 0
    away = dataclasses.replace(frame, truth=truth(0, foothold=landing(0.5), surface=SURFACE))
    assert score([away], plain=False).near == []


def test_the_bounds_are_those_of_the_fault_campaign() -> None:
    for name in ("WRONG_SLOPE_RAD", "WRONG_HEIGHT_M", "SIGMAS"):
        assert getattr(terrain_score, name) == getattr(criteria, name)


def test_who_stands_above_a_drop_is_told_of_it() -> None:
    frames = kerb_walk(-0.15, 5)
    found = score(frames, plain=False)
    assert (found.before_drop, found.drop_told) == (60, 55)
