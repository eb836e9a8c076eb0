"""What becomes of a calibration file in which a single character has changed: used all the same, or refused?

    python -m benchmarks.calibration_changes [--changes 11589] [--seed 1]

Changes of a simulated unit's file are drawn: one digit for another, and any (another of the characters that stand in
such files, one left out, one doubled). Each is loaded as the service loads it, and once more without asking for its
seal; what is used is compared with the calibration that was written. The worst is told by how far it tilts the ground:
by the mounting, the pair's rotation or the accelerometer's bias.
"""

import argparse
import random
import string
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from calib.files import format_calibration, load_calibration, parse_calibration
from calib.seal import sealed
from messages import Calibration, Matrix3, UnitCalibration, UserError
from messages.constants import STANDARD_GRAVITY_MPS2
from sim_rig.unit import draw_unit

CHARACTERS = string.digits + ".-+e #:,[]{}" + "abx\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--changes", type=int, default=11_589)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    calibration = draw_unit(arguments.seed).exact_calibration()
    text = sealed(format_calibration(calibration))
    drawn = random.Random(arguments.seed)
    print(f"{arguments.changes} changes of one character of each kind, file of {len(text)} characters")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibration.yaml"
        for kind, change in (("a digit for another", _other_digit), ("any character", _any_change)):
            measure(kind, [change(text, drawn) for _ in range(arguments.changes)], calibration, path)


def measure(kind: str, texts: list[str], calibration: Calibration, path: Path) -> None:
    """Print what becomes of the changed `texts` of a file that holds `calibration`; `path` is written over."""
    with_seal, without = Counter[str](), Counter[str]()
    worst_deg = 0.0
    for text in texts:
        path.write_text(text, encoding="utf-8", newline="")
        try:
            with_seal[_verdict(load_calibration(path), calibration)] += 1
        except UserError:
            with_seal["refused"] += 1
        try:
            found = parse_calibration(text, "memory")
        except UserError:
            without["refused"] += 1
            continue
        without[_verdict(found, calibration)] += 1
        worst_deg = max(worst_deg, _tilt_deg(found, calibration))
    print(f"{kind:22}{'with the seal':>16}{'without':>16}")
    for verdict in ("used, values changed", "used, values the same", "refused"):
        shares = (f"{count[verdict]} ({100 * count[verdict] / len(texts):.1f} %)" for count in (with_seal, without))
        print(f"  {verdict:20}" + "".join(f"{share:>16}" for share in shares))
    print(f"  largest tilt of the ground that would have been used without the seal: {worst_deg:.2f}°")


def _other_digit(text: str, drawn: random.Random) -> str:
    place = drawn.choice([k for k, character in enumerate(text) if character.isdigit()])
    digit = drawn.choice([character for character in string.digits if character != text[place]])
    return text[:place] + digit + text[place + 1 :]


def _any_change(text: str, drawn: random.Random) -> str:
    place = drawn.randrange(len(text))
    before, there, after = text[:place], text[place], text[place + 1 :]
    other = drawn.choice([character for character in CHARACTERS if character != there])
    return before + drawn.choice([other, other, "", there + there, there + other]) + after


def _verdict(found: UnitCalibration, calibration: Calibration) -> str:
    return "used, values the same" if found == calibration else "used, values changed"


def _tilt_deg(found: UnitCalibration, calibration: Calibration) -> float:
    """Return the largest of the turns that a changed mounting, pair or accelerometer bias gives the ground, degrees."""
    if not isinstance(found, Calibration):
        return 0.0
    bias = np.subtract(found.imu.sf_bias_mps2, calibration.imu.sf_bias_mps2)
    turns = (
        _turn_deg(found.X_BL.R, calibration.X_BL.R),
        _turn_deg(found.stereo.X_RL.R, calibration.stereo.X_RL.R),
        float(np.degrees(np.arctan(np.linalg.norm(bias) / STANDARD_GRAVITY_MPS2))),
    )
    return max(turns)


def _turn_deg(one: Matrix3, other: Matrix3) -> float:
    difference = np.array(one).T @ np.array(other)
    return float(np.degrees(np.arccos(np.clip((np.trace(difference) - 1.0) / 2.0, -1.0, 1.0))))


if __name__ == "__main__":
    main()
