"""Scoring of what was said of the ground ahead against the truth, walk by walk; pure functions of both.

What a figure counts is said at the function that makes it. Distances are along the path, times are those of exposure:
what an estimator takes to compute and to publish is not part of these figures.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import msgspec

from lab.evaluation.terrain_said import EdgeSaid, TerrainSaid
from sim_rig.walk.terrain_truth import FLIGHT_M, EdgeTruth, SurfaceTruth, TerrainTruth

WRONG_SLOPE_RAD, WRONG_HEIGHT_M, SIGMAS = math.radians(3.0), 0.045, 4.0
"""What is valid and wrong: beyond a bound and beyond so many stated deviations; the fault campaign's bounds."""
MATCH_M = 0.12
"""An edge that is said stands for a true one, of the same direction, no farther from it than this."""
HELD_FRAMES = 4
"""Frames before the instant in question, in one of which the edge must be said: 0.2 s."""
KNOWN_BEFORE_S = 0.8
LANDING_BEFORE_S = 0.25
SETTLED_S = 0.5
"""After the first frame; edges that feet come to earlier are not counted."""
SEEN_BELOW_M = 0.06
NEAR_M, NEAR_FROM_M, NEAR_TO_M = 0.35, 0.9, 1.1
ON_EDGE_M = 0.02
AROUND_CHANGE = 2
SAME_PLACE_M, SAME_TIME_S = 0.15, 0.5


@dataclass(frozen=True)
class JudgedFrame:
    """One frame: the truth, what was said (None: nothing), and the true ground `under` the place said for the foot."""

    truth: TerrainTruth
    said: TerrainSaid | None
    under: SurfaceTruth | None = None


class EdgeCounts(msgspec.Struct):
    """Of edges one way: how many there were and how many were known in time, for the toe and for the contact."""

    edges: int = 0
    in_time: int = 0
    unseen: int = 0
    transitions: int = 0
    known: int = 0


class Near(msgspec.Struct):
    """A height said near an edge: its error, and the standard deviation said."""

    error_m: float
    sd_m: float


class WalkScore(msgspec.Struct):
    """The figures of one walk; lists hold one error for each frame and edge, or for each landing."""

    frames: int = 0
    said: int = 0
    plain_m: float = 0.0
    false_edges: int = 0
    up: EdgeCounts = msgspec.field(default_factory=EdgeCounts)
    down: EdgeCounts = msgspec.field(default_factory=EdgeCounts)
    rise_up_m: list[float] = []
    rise_down_m: list[float] = []
    distance_up_m: list[float] = []
    distance_down_m: list[float] = []
    tread_m: list[float] = []
    bounds: int = 0
    bounds_hold: int = 0
    confusion: dict[str, int] = {}
    landings: int = 0
    landing_ahead_m: list[float] = []
    landing_left_m: list[float] = []
    landing_s: list[float] = []
    near_frames: int = 0
    near: list[Near] = []
    valid: int = 0
    wrong: int = 0
    before_drop: int = 0
    drop_told: int = 0


def score(frames: Sequence[JudgedFrame], *, plain: bool) -> WalkScore:
    """Return the figures of one walk, its frames in the order of time; `plain` where false edges are counted."""
    matches = [matched(frame) for frame in frames]
    found = WalkScore(frames=len(frames), said=sum(frame.said is not None for frame in frames))
    if plain:
        found.plain_m, found.false_edges = walked_m(frames), false_edges(frames)
    _score_edges(found, frames, matches)
    _score_measures(found, frames, matches)
    found.confusion = confusion(frames)
    _score_landings(found, frames)
    _score_heights(found, frames)
    _score_standing(found, frames, matches)
    return found


def matched(frame: JudgedFrame) -> Mapping[float, EdgeSaid]:
    """Return, by x of W of each true edge that was said, what was said of it: nearest pairs first, each edge once."""
    if frame.said is None:
        return {}
    pairs = sorted(
        (abs(said.distance_m - true.distance_m), i, j)
        for i, true in enumerate(frame.truth.edges)
        for j, said in enumerate(frame.said.edges)
        if said.rise_m * true.rise_m > 0 and abs(said.distance_m - true.distance_m) <= MATCH_M
    )
    taken: dict[int, int] = {}
    for _, i, j in pairs:
        if i not in taken and j not in taken.values():
            taken[i] = j
    return {frame.truth.edges[i].x_m: frame.said.edges[j] for i, j in taken.items()}


def walked_m(frames: Sequence[JudgedFrame]) -> float:
    """Return the length of way between the first and the last frame."""
    return sum(
        abs(after.truth.x_W_m - before.truth.x_W_m) / max(abs(after.truth.way_m), 0.1)
        for before, after in pairwise(frames)
    )


def false_edges(frames: Sequence[JudgedFrame]) -> int:
    """Return how many edges were said where there are none.

    What is said again within `SAME_TIME_S` no more than `SAME_PLACE_M` from there on the ground is the same edge.
    """
    count = 0
    known: list[tuple[float, int]] = []
    for frame in frames:
        t_ns = frame.truth.t_true_ns
        known = [(x, seen_ns) for x, seen_ns in known if 1e-9 * (t_ns - seen_ns) <= SAME_TIME_S]
        for edge in frame.said.edges if frame.said is not None else ():
            if any(abs(edge.distance_m - true.distance_m) <= MATCH_M for true in frame.truth.edges):
                continue
            x_m = frame.truth.x_W_m + edge.distance_m * frame.truth.way_m
            same = [one for one in known if abs(one[0] - x_m) <= SAME_PLACE_M]
            count += not same
            known = [one for one in known if one not in same] + [(x_m, t_ns)]
    return count


def confusion(frames: Sequence[JudgedFrame]) -> dict[str, int]:
    """Return how many frames of each true kind were said to be of which: "true>said", without frames around a change.

    `AROUND_CHANGE` frames on either side of a change of the true kind are left out; nothing said is "none".
    """
    kinds = [frame.truth.kind for frame in frames]
    changes = [k for k in range(1, len(kinds)) if kinds[k] != kinds[k - 1]]
    counts: dict[str, int] = {}
    for k, frame in enumerate(frames):
        if any(change - AROUND_CHANGE <= k < change + AROUND_CHANGE for change in changes):
            continue
        said = "none" if frame.said is None else str.__str__(frame.said.kind)
        name = f"{frame.truth.kind}>{said}"
        counts[name] = counts.get(name, 0) + 1
    return counts


def mean_recall(counts: Mapping[str, int]) -> float:
    """Return the share of frames whose kind was right, averaged over the true kinds; NaN without frames."""
    of_kind: dict[str, int] = {}
    for name, count in counts.items():
        kind = name.partition(">")[0]
        of_kind[kind] = of_kind.get(kind, 0) + count
    shares = [counts.get(f"{kind}>{kind}", 0) / total for kind, total in of_kind.items()]
    return sum(shares) / len(shares) if shares else math.nan


def _score_edges(found: WalkScore, frames: Sequence[JudgedFrame], matches: Sequence[Mapping[float, EdgeSaid]]) -> None:
    """Count the edges known before the leading toe is near, and the transitions known before the contact.

    An edge no part of whose riser was in view before is `unseen` and not counted. A transition is an edge with none
    the same way within a flight's tread before it.
    """
    if not frames:
        return
    edges: dict[float, list[EdgeTruth]] = {}
    for frame in frames:
        for edge in frame.truth.edges:
            edges.setdefault(edge.x_m, []).append(edge)
    for x_m, seen in edges.items():
        one = seen[0]
        counts = found.up if one.rise_m > 0 else found.down
        until = _frames_until(frames, one.t_toe_ns)
        if until is not None:
            in_view = [e.visible for f in frames[:until] for e in f.truth.edges if e.x_m == x_m]
            if one.rise_m > 0 and not any(in_view):
                counts.unseen += 1
            else:
                counts.edges += 1
                counts.in_time += any(x_m in said for said in matches[max(0, until - HELD_FRAMES) : until])
        within = any(0.0 < x_m - other <= FLIGHT_M and edges[other][0].rise_m * one.rise_m > 0 for other in edges)
        contact_ns = None if one.t_contact_ns is None else one.t_contact_ns - round(1e9 * KNOWN_BEFORE_S)
        until = _frames_until(frames, contact_ns)
        if until is not None and not within:
            counts.transitions += 1
            counts.known += any(x_m in said for said in matches[max(0, until - HELD_FRAMES) : until])


def _frames_until(frames: Sequence[JudgedFrame], t_ns: int | None) -> int | None:
    """Return how many frames come before an instant; None where it is not while the walk is judged."""
    if t_ns is None or not frames[0].truth.t_true_ns + 1e9 * SETTLED_S <= t_ns <= frames[-1].truth.t_true_ns:
        return None
    return sum(frame.truth.t_true_ns < t_ns for frame in frames)


def _score_measures(
    found: WalkScore, frames: Sequence[JudgedFrame], matches: Sequence[Mapping[float, EdgeSaid]]
) -> None:
    """Note the errors of rises (falling: where enough is seen), of distances about a metre ahead, and of treads."""
    for frame, said in zip(frames, matches, strict=True):
        for true in frame.truth.edges:
            edge = said.get(true.x_m)
            if edge is None:
                continue
            if edge.bound_only:
                found.bounds += 1
                found.bounds_hold += true.rise_m <= edge.rise_m + _BOUND_SLACK_M
            elif true.rise_m > 0:
                found.rise_up_m.append(edge.rise_m - true.rise_m)
            elif true.visible >= SEEN_BELOW_M:
                found.rise_down_m.append(edge.rise_m - true.rise_m)
            if NEAR_FROM_M <= true.distance_m <= NEAR_TO_M:
                distances = found.distance_up_m if true.rise_m > 0 else found.distance_down_m
                distances.append(edge.distance_m - true.distance_m)
        for one, other in pairwise(frame.truth.edges):
            if one.x_m in said and other.x_m in said and abs(other.distance_m - one.distance_m) <= FLIGHT_M:
                tread_m = said[other.x_m].distance_m - said[one.x_m].distance_m
                found.tread_m.append(tread_m - (other.distance_m - one.distance_m))


def _score_landings(found: WalkScore, frames: Sequence[JudgedFrame]) -> None:
    """Note where and when each next foot was said to land, in the last frame `LANDING_BEFORE_S` before it does."""
    last: dict[int, JudgedFrame] = {}
    for frame in frames:
        foothold = frame.truth.foothold
        if foothold is not None and 1e-9 * (foothold.t_land_ns - frame.truth.t_true_ns) >= LANDING_BEFORE_S:
            last[foothold.t_land_ns] = frame
    for t_land_ns, frame in last.items():
        true = frame.truth.foothold
        if true is None or 1e-9 * (t_land_ns - frame.truth.t_true_ns) > LANDING_BEFORE_S + _FRAME_S:
            continue
        found.landings += 1
        said = None if frame.said is None else frame.said.foothold
        if said is not None and math.isfinite(said.time_to_contact_s):
            found.landing_ahead_m.append(said.ahead_m - true.ahead_m)
            found.landing_left_m.append(said.left_m - true.left_m)
            found.landing_s.append(said.time_to_contact_s - 1e-9 * (t_land_ns - frame.truth.t_true_ns))


def _score_heights(found: WalkScore, frames: Sequence[JudgedFrame]) -> None:
    """Note the errors of heights near edges, and count what is wrong and valid anywhere.

    The ground is that under the place that was said, so that misplacing the foot is not counted twice. A place within
    `ON_EDGE_M` of an edge has two heights and is not judged.
    """
    for frame in frames:
        true, under = frame.truth.surface, frame.under
        near = true is not None and bool(true.from_edge_m <= NEAR_M)
        found.near_frames += near
        said = None if frame.said is None else frame.said.foothold
        if said is None or under is None or under.from_edge_m < ON_EDGE_M or not math.isfinite(said.height_m):
            continue
        error_m = said.height_m - under.below_m
        if near:
            found.near.append(Near(error_m, said.height_sd_m))
        found.valid += 1
        found.wrong += any(
            not abs(error) <= max(SIGMAS * sd, bound)  # so written, a NaN is wrong too
            for error, bound, sd in (
                (error_m, WRONG_HEIGHT_M, said.height_sd_m),
                (said.slope_sagittal_rad - under.slope_sagittal_rad, WRONG_SLOPE_RAD, said.slope_sagittal_sd_rad),
                (said.slope_frontal_rad - under.slope_frontal_rad, WRONG_SLOPE_RAD, said.slope_frontal_sd_rad),
            )
        )


def _score_standing(
    found: WalkScore, frames: Sequence[JudgedFrame], matches: Sequence[Mapping[float, EdgeSaid]]
) -> None:
    """Count the frames of who stands before a falling edge, and those in which it was told."""
    for frame, said in zip(frames, matches, strict=True):
        falls = [edge for edge in frame.truth.edges if edge.rise_m < 0]
        if frame.truth.foothold is None and falls:
            found.before_drop += 1
            found.drop_told += falls[0].x_m in said


_BOUND_SLACK_M = 0.01
_FRAME_S = 0.075  # a frame and a half
