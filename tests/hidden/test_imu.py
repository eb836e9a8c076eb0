"""Hidden effects of the IMU: drawn where the finder cannot see them, found by a fresh process in files alone."""

import secrets
from pathlib import Path

from lab.hidden import imu as hidden
from lab.hidden.case import Case, Kind
from tests.bench.trials import explained, prevails

PLAIN_RADPS2 = 3e-4
"""A drift of the bias that no recording of a minute hides."""


def test_what_is_hidden_is_named_what_is_not_is_not_and_what_nobody_knows_is_unknown(tmp_path: Path) -> None:
    assert prevails("imu", hidden, tmp_path)


def test_two_effects_at_once_are_both_named(tmp_path: Path) -> None:
    assert prevails("imu", hidden, tmp_path, (Kind.PAIR,))


def test_what_the_recording_cannot_tell_apart_is_declared_not_guessed(tmp_path: Path) -> None:
    truth = None
    while truth is None or truth.causes[0].size < PLAIN_RADPS2:
        case = Case("imu", 1000 + secrets.randbelow(1 << 30), Kind.SINGLE, ("gyro_bias_drift",))
        truth = hidden.write(case, tmp_path / "fit", tmp_path / "held_out")
    print(truth)
    for place in ("fit", "held_out"):
        file = tmp_path / place / "imu.csv"
        rows = [line.rsplit(",", 1)[0] for line in file.read_text(encoding="utf-8").splitlines()]  # no temperature log
        file.write_text("\n".join(rows) + "\n", encoding="utf-8")
    verdict = explained("imu", tmp_path)
    print(verdict)
    first = verdict.causes[0]
    assert {first.name, *first.equivalents} >= {"gyro_bias_drift", "temperature"}
    assert verdict.next_experiment is not None
    assert "temperature" in verdict.next_experiment
