"""One simulated walk: what the pipeline makes of it changes openly or not at all."""

import json
from collections import Counter
from functools import partial

import cv2
import numpy as np
import pytest

from messages import Calibration, Input
from messages.arrays import rms
from messages.constants import NORMAL_95
from tests.replay.freeze import deviations, frozen, frozen_walk, replayed

_CV_CPU_AVX2 = 11  # OpenCV's number of the instruction set, which its Python module does not name

# Between OpenBLAS's kernels for Haswell, Zen, SkylakeX and Sandybridge, with one and two threads, with and without
# numpy's AVX-512, every field stays within 1e-10 of its standard deviation or unit. Where OpenCV has no AVX2 it rounds
# pixels in another way: the ground moves by up to 2 % of its standard deviation, the velocity by up to 14 %.
_MOST = 1e-6
_MOST_WITH_OTHER_PIXELS = 0.3


@pytest.fixture(scope="module")
def walk() -> tuple[Calibration, list[Input]]:
    return frozen_walk()


@pytest.fixture(scope="module")
def replay(walk: tuple[Calibration, list[Input]]) -> bytes:
    return replayed(*walk)


def test_the_walk_is_replayed_as_it_was_frozen(replay: bytes) -> None:
    allowed = _MOST if cv2.checkHardwareSupport(_CV_CPU_AVX2) else _MOST_WITH_OTHER_PIXELS
    for field, most in deviations(replay, frozen()).items():
        assert most <= allowed, f"{field} differs; if it is meant to: python -m tests.replay.freeze --write"


@pytest.mark.parametrize("threads", [1, 3])
def test_two_replays_give_the_same_bytes(
    walk: tuple[Calibration, list[Input]], replay: bytes, threads: int, request: pytest.FixtureRequest
) -> None:
    request.addfinalizer(partial(cv2.setNumThreads, cv2.getNumThreads()))
    cv2.setNumThreads(threads)
    assert replayed(*walk) == replay


def test_estimates_name_their_calibration(walk: tuple[Calibration, list[Input]], replay: bytes) -> None:
    assert {json.loads(line)["calibration_id"] for line in replay.splitlines()} == {walk[0].id}


def test_the_frozen_walk_has_a_start_two_slopes_and_both_silences() -> None:
    lines = [json.loads(line) for line in frozen().splitlines()]
    grounds = [line for line in lines if line["topic"] == "ground"]
    valid = [line["slope_sagittal_rad"] for line in grounds if line["status"] == "valid"]
    assert sum(abs(slope) < 0.02 for slope in valid) > 15
    assert sum(abs(slope - 0.087) < 0.02 for slope in valid) > 5
    assert {"starting", "no_frame", "no_imu"} <= Counter(line["reason"] for line in grounds).keys()


def test_the_carried_ground_agrees_with_the_next_frame_as_well_as_both_say(replay: bytes) -> None:
    """At each exposure: the last frame's plane carried there, against that frame's own; and held, for comparison."""
    fields = ("slope_sagittal_rad", "slope_frontal_rad", "height_m")
    path: list[tuple[int, list[float]]] = []
    held: list[float] | None = None
    off, height_off_m, held_off_m = [], [], []
    for line in map(json.loads, replay.splitlines()):
        if line["topic"] == "propagated_ground":
            plane = [*(line[name] for name in fields), *(line["covariance"][k] for k in (0, 3, 5))]
            path = [*path, (line["t_sample_ns"], plane)] if line["status"] == "valid" else []
        elif line["topic"] == "ground" and line["status"] == "valid":
            t_ns, told = line["t_exposure_ns"], np.array([line[name] for name in fields])
            times_ns = [t for t, _ in path]
            if len(path) > 1 and times_ns[0] <= t_ns <= times_ns[-1] and held is not None:
                carried = np.array(
                    [np.interp(t_ns, times_ns, column) for column in zip(*(p for _, p in path), strict=True)]
                )
                variances = carried[3:] + np.array(line["covariance"])[[0, 3, 5]]
                off.append(np.abs(told - carried[:3]) <= NORMAL_95 * np.sqrt(variances))
                height_off_m.append(told[2] - carried[2])
                held_off_m.append(told[2] - held[2])
            held = told.tolist()
    assert len(off) > 30
    assert np.mean(off, axis=0).min() >= 0.95
    assert rms(np.array(height_off_m)) < 0.003
    assert rms(np.array(held_off_m)) > 2.0 * rms(np.array(height_off_m))
