"""Something is hidden in recordings of the platform, from seeds that nobody knew before: the finder must tell what.

A fresh process gets the files and nothing else. With 120 and more cases `gaiteyes explain court` does the same.
"""

import secrets
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from discrepancy.verdict import Verdict
from sim_rig.hidden import platform as hidden_platform
from sim_rig.hidden.case import Case, Kind, Truth

SINGLES = 2


def judged(case: Case, folder: Path) -> tuple[Truth, Verdict]:
    """Return what a case hides and what the finder says of its files."""
    truth = hidden_platform.write(case, folder / "fit", folder / "held_out")
    command = [sys.executable, "-m", "cli.main", "explain", "platform", str(folder / "fit")]
    command += ["--held-out", str(folder / "held_out"), "--out", str(folder / "out"), "--no-report"]
    subprocess.run(command, check=True, capture_output=True)
    return truth, msgspec.json.decode((folder / "out" / "verdict.json").read_bytes(), type=Verdict)


def test_what_is_hidden_is_named_and_helps_on_other_data_and_clean_data_name_nothing(tmp_path: Path) -> None:
    draw = secrets.SystemRandom()
    misses = []
    for number in range(SINGLES + 1):
        seed = 1000 + secrets.randbelow(2**40)
        effects = () if number == SINGLES else (draw.choice(hidden_platform.EFFECTS),)
        case = Case("platform", seed, Kind.SINGLE if effects else Kind.CLEAN, effects)
        truth, verdict = judged(case, tmp_path / str(number))
        told = [cause.name for cause in verdict.causes]
        shown = f"{case.kind.value} {' '.join(effects)} seed {seed}"
        print(f"{shown}: {verdict.verdict} {told}; true {[cause.parameters for cause in truth.causes]}")
        if not effects:
            right = verdict.verdict == "nothing" and not told
        else:
            accepted = [name for cause in verdict.causes[:1] for name in (cause.name, *cause.equivalents)]
            gain = verdict.gain.share_of_excess_removed
            right = effects[0] in accepted and verdict.verdict == "named" and gain is not None and gain >= 0.5
        if not right:
            misses.append(shown)
    if len(misses) > 1:
        pytest.fail(f"missed: {', '.join(misses)}")


def test_a_case_follows_from_its_seed_alone_and_its_files_tell_nothing_of_it(tmp_path: Path) -> None:
    case = Case("platform", 1000 + secrets.randbelow(2**40), Kind.SINGLE, ("force_gain",))
    print(case)
    first, second = (hidden_platform.write(case, tmp_path / k / "fit", tmp_path / k / "held") for k in ("a", "b"))
    assert first == second
    for place in ("fit", "held"):
        files = sorted((tmp_path / "a" / place).iterdir())
        assert [file.name for file in files] == ["force_plate.csv", "motion.csv", "platform.toml"]
        for file in files:
            assert file.read_bytes() == (tmp_path / "b" / place / file.name).read_bytes()
        assert b"truth" not in (tmp_path / "a" / place / "platform.toml").read_bytes()
