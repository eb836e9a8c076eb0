"""Hidden effects of the IMU: drawn where the finder cannot see them, found by a fresh process in files alone."""

import secrets
import subprocess
import sys
from pathlib import Path

from discrepancy.verdict import Verdict, from_json
from sim_rig.hidden.case import Case, Kind, TrueCause, Truth
from sim_rig.hidden.imu import write

PLAIN = ("time_offset", "clock_drift", "gyro_scale", "gyro_misalignment", "g_sensitivity", "frame_rotation", "low_pass")
"""Effects that look like no other at any size that is drawn: one unlucky draw must not fail the test."""


def found(case: Case, folder: Path) -> tuple[Truth, Verdict]:
    truth = write(case, folder / "fit", folder / "held_out")
    command = [sys.executable, "-m", "cli.main", "explain", "imu", str(folder / "fit")]
    options = ["--held-out", str(folder / "held_out"), "--out", str(folder / "out"), "--no-report"]
    subprocess.run([*command, *options], check=True, capture_output=True, timeout=300)
    return truth, from_json((folder / "out" / "verdict.json").read_bytes())


def check_size(verdict: Verdict, cause: TrueCause) -> None:
    """Hold the told parameters against the true ones: nearer than three times the interval's half, or 5 %."""
    told = next(each for each in verdict.causes if each.name == cause.name)
    for name, value in cause.parameters.items():
        quantity = told.parameters[name]
        assert quantity.value is not None
        assert quantity.low is not None
        assert quantity.high is not None
        assert abs(quantity.value - value) < max(1.5 * (quantity.high - quantity.low), 0.05 * abs(value)), name


def test_a_hidden_effect_is_named_with_its_size_and_its_gain(tmp_path: Path) -> None:
    seed = 1000 + secrets.randbelow(1 << 30)
    effect = secrets.choice(PLAIN)
    print(f"seed {seed}, {effect}")
    truth, verdict = found(Case("imu", seed, Kind.SINGLE, (effect,)), tmp_path)
    print(truth, verdict)
    assert verdict.verdict == "named"
    first = verdict.causes[0]
    assert effect in (first.name, *first.equivalents)
    if first.name == effect:
        check_size(verdict, truth.causes[0])
    assert verdict.gain.share_of_excess_removed is not None
    assert verdict.gain.share_of_excess_removed > 0.8


def test_two_effects_at_once_are_both_named(tmp_path: Path) -> None:
    seed = 1000 + secrets.randbelow(1 << 30)
    print(f"seed {seed}, frame_rotation and gyro_scale")
    truth, verdict = found(Case("imu", seed, Kind.PAIR, ("frame_rotation", "gyro_scale")), tmp_path)
    print(truth, verdict)
    assert {"frame_rotation", "gyro_scale"} <= {cause.name for cause in verdict.causes}


def test_a_perfect_imu_is_accused_of_nothing(tmp_path: Path) -> None:
    seed = 1000 + secrets.randbelow(1 << 30)
    print(f"seed {seed}, clean")
    _, verdict = found(Case("imu", seed, Kind.CLEAN, ()), tmp_path)
    print(verdict)
    assert verdict.causes == []


def test_what_no_library_holds_is_not_named(tmp_path: Path) -> None:
    seed = 1000 + secrets.randbelow(1 << 30)
    mechanism = secrets.choice(("axis_skew", "cross_coupled_rate"))
    print(f"seed {seed}, {mechanism}")
    truth, verdict = found(Case("imu", seed, Kind.OUTSIDE, (mechanism,)), tmp_path)
    print(truth, verdict)
    assert verdict.verdict == "unknown"
