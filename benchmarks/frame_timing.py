"""Pictures that are told early, late, seldom or not at all, and a service that is short of time: how much of the ground
is valid, and how right is it?

    python -m benchmarks.frame_timing [--cases "reduced work" …] [--seeds 1000-1002] [--seconds 10]

The whole pipeline, faster than real time, on walks of the rig with the calibration that a unit would have; all cases of
a seed see the same walk. Counted are the frames that arrive from the fourth second on.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import msgspec
import numpy as np

from lab.faults.criteria import errors_of
from lab.faults.offline import START_NS, WALKS, Message, OfflineWalk, arrival_ns
from messages import GroundPlane, Load, LoadLevel, Status, StereoFrame
from messages.arrays import FloatArray, column_rms

FROM_NS = START_NS + 4_000_000_000

FrameChange = Callable[[StereoFrame], StereoFrame | None]
"""From a frame to what arrives of it, None for nothing."""


@dataclass(frozen=True)
class Case:
    """What becomes of each frame, and how much work the pipeline may do on it."""

    change: FrameChange
    load: Load = Load.NORMAL


@dataclass(frozen=True)
class Counted:
    """What became of one walk: frames, valid ones, wrong ones of those; slope along and height (n, 2) less the true
    ones, rad and m, away from edges."""

    frames: int
    valid: int
    wrong: int
    errors: FloatArray


def told_after(latency_s: float) -> FrameChange:
    """Return what makes each frame arrive so long after its exposure."""

    def changed(frame: StereoFrame) -> StereoFrame:
        arrival_ns = frame.header.t_exposure_ns + round(1e9 * latency_s)
        header = msgspec.structs.replace(frame.header, t_arrival_ns=arrival_ns)
        return StereoFrame(header=header, left=frame.left, right=frame.right)

    return changed


def kept(keeps: Callable[[int], bool]) -> FrameChange:
    """Return what passes only the frames whose number is kept."""
    return lambda frame: frame if keeps(frame.header.seq) else None


def _chance(seq: int) -> float:
    return float(np.random.default_rng(seq).random())


CASES = {
    "as the rig's camera": Case(kept(lambda _: True)),
    "told after 2 ms": Case(told_after(0.002)),
    "told after 100 ms": Case(told_after(0.100)),
    "every second, 10 Hz": Case(kept(lambda seq: seq % 2 == 0)),
    "every third, 6.7 Hz": Case(kept(lambda seq: seq % 3 == 0)),
    "30 % lost": Case(kept(lambda seq: _chance(seq) > 0.3)),
    "60 % lost": Case(kept(lambda seq: _chance(seq) > 0.6)),
    "reduced work": Case(kept(lambda _: True), Load.REDUCED),
    "reduced, 10 % lost": Case(kept(lambda seq: _chance(seq) > 0.1), Load.REDUCED),
}


def changed_inputs(walk: OfflineWalk, change: FrameChange) -> list[Message]:
    """Return what the pipeline is given, in order of arrival, when `change` is made to each frame."""
    changed = (change(message) if isinstance(message, StereoFrame) else message for message in walk.inputs)
    return sorted((message for message in changed if message is not None), key=arrival_ns)


def counted(walk: OfflineWalk, case: Case) -> Counted:
    """Return what the pipeline makes of a walk in this case."""
    pipeline, grounds = walk.new_pipeline(), []
    for message in [LoadLevel(t_ns=START_NS, load=case.load), *changed_inputs(walk, case.change)]:
        grounds += [told for told in pipeline.step(message) if isinstance(told, GroundPlane) and told.frame_seq >= 0]
    grounds = [ground for ground in grounds if ground.t_exposure_ns >= FROM_NS]
    valid = [(ground, walk.wearer.truth_of(ground)) for ground in grounds if ground.status is Status.VALID]
    off = [
        (ground.slope_sagittal_rad - truth.slope_sagittal_rad, ground.height_m - truth.height_m)
        for ground, truth in valid
        if not truth.transition
    ]
    wrong = sum(errors_of(ground, truth).wrong for ground, truth in valid)
    return Counted(len(grounds), len(valid), wrong, np.array(off).reshape(-1, 2))


def main() -> None:
    """Walk and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=list(CASES))
    parser.add_argument("--seeds", default="1000-1002", help="rig units, first-last")
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    first, last = map(int, options.seeds.split("-"))
    cv2.setNumThreads(1)
    found: dict[str, list[Counted]] = {case: [] for case in options.cases}
    for seed in range(first, last + 1):
        walk = OfflineWalk(seed, WALKS[seed % len(WALKS)], options.seconds)
        for case, walks in found.items():
            walks.append(counted(walk, CASES[case]))
    print(f"{'frames':22}{'of':>6}{'valid':>8}{'wrong':>7}{'slope RMS':>12}{'height RMS':>12}")
    for case, walks in found.items():
        frames, valid = sum(walk.frames for walk in walks), sum(walk.valid for walk in walks)
        slope_rad, height_m = column_rms(np.vstack([walk.errors for walk in walks]))
        wrong = sum(walk.wrong for walk in walks)
        print(
            f"{case:22}{frames:6}{valid / frames:8.1%}{wrong:7}{np.degrees(slope_rad):11.3f}°{1e3 * height_m:9.1f} mm"
        )


if __name__ == "__main__":
    main()
