"""Hidden effects of the wearable: drawn where the finder cannot see them, found by a fresh process in files alone."""

import secrets
import subprocess
import sys
from pathlib import Path

import pytest

from discrepancy.verdict import Verdict, from_json
from sim_rig.hidden.case import Case, Kind, Truth
from sim_rig.hidden.wearable import write

PLAIN = ("time_offset", "acceleration_disturbance")
"""Effects that change with time and look like no other at any size that is drawn."""


def found(case: Case, folder: Path) -> tuple[Truth, Verdict]:
    truth = write(case, folder / "fit", folder / "held_out")
    command = [sys.executable, "-m", "cli.main", "explain", "wearable", str(folder / "fit")]
    options = ["--held-out", str(folder / "held_out"), "--out", str(folder / "out"), "--no-report"]
    subprocess.run([*command, *options], check=True, capture_output=True, timeout=300)
    return truth, from_json((folder / "out" / "verdict.json").read_bytes())


def test_a_hidden_effect_is_named_with_its_size_and_its_gain(tmp_path: Path) -> None:
    seed = 1000 + secrets.randbelow(1 << 30)
    effect = secrets.choice(PLAIN)
    print(f"seed {seed}, {effect}")
    truth, verdict = found(Case("wearable", seed, Kind.SINGLE, (effect,)), tmp_path)
    print(truth, verdict)
    assert verdict.verdict == "named"
    first = verdict.causes[0]
    assert effect in (first.name, *first.equivalents)
    if first.name == effect:
        for name, value in truth.causes[0].parameters.items():
            told = first.parameters[name].value
            assert told == pytest.approx(value, rel=0.15)
    assert verdict.gain.share_of_excess_removed is not None
    assert verdict.gain.share_of_excess_removed > 0.5


def test_a_sound_unit_is_accused_of_nothing(tmp_path: Path) -> None:
    seed = 1000 + secrets.randbelow(1 << 30)
    print(f"seed {seed}, clean")
    _, verdict = found(Case("wearable", seed, Kind.CLEAN, ()), tmp_path)
    print(verdict)
    assert verdict.causes == []
