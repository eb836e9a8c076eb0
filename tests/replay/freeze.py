"""The frozen walk: what the pipeline made of one simulated walk when it was last frozen.

`python -m tests.replay.freeze` replays the walk, prints the sha256 of what a replay writes, for a comparison before and
after a change on one machine, and how far the numbers lie from the frozen ones; with `--write` it freezes them anew.
"""

import argparse
import gzip
import hashlib
import json
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np

from daemon.pipeline import Pipeline
from daemon.replay import replay
from messages import Calibration, Frame, ImuSample, Input
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.legs import Stand, Walk
from sim_rig.walk.scenario import Scenario
from sim_rig.walk.world import WorldBuilder
from sim_rig.wearer import SimulatedWearer

FROZEN: Final = Path(__file__).with_name("frozen_walk.jsonl.gz")

_DIAGONAL: Final = [0, 3, 5]  # of an upper triangle

_START_NS: Final = 10_000_000_000
_SECONDS: Final = 4.0
_WITHOUT_FRAMES_S: Final = (2.6, 2.85)
_WITHOUT_IMU_S: Final = (3.4, 3.5)


def frozen_walk() -> tuple[Calibration, list[Input]]:
    """Return what the pipeline is given: a start at rest, level ground, a ramp, a camera and an IMU that pause."""
    ground = WorldBuilder().level(2.2, "concrete").ramp(4.0, 5.0, "brick").ramp(4.0, -5.0, "brick").build()
    scenario = Scenario("frozen", "level ground, then a ramp of 5°", ground, (Stand(1.2), Walk(10.2, 1.2, 1.8)))
    wearer = SimulatedWearer(5, scenario, _START_NS)
    return wearer.calibration, [m for m in wearer.offline_inputs(_SECONDS) if not _is_lost(m)]


def replayed(calibration: Calibration, inputs: list[Input]) -> bytes:
    """Return the file that a replay of `inputs` writes."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "estimates.jsonl")
        replay(inputs, Pipeline(calibration, FootholdSettings()), out)
        return out.read_bytes()


def frozen() -> bytes:
    """Return the frozen file."""
    return gzip.decompress(FROZEN.read_bytes())


def deviations(found: bytes, wanted: bytes) -> dict[str, float]:
    """Return how far the numbers of two replays differ at most, by "topic.field".

    In standard deviations where the estimate states them, else in the field's unit. What is no floating-point number
    differs by nothing or infinitely. The calibration's id is left out: of a simulated unit it follows the last bits.
    """
    most: dict[str, float] = {}
    for ours, theirs in zip(_lines(found), _lines(wanted), strict=True):
        scales = _scales(theirs)
        for field in ours.keys() | theirs.keys():
            name = f"{ours['topic']}.{field}"
            most[name] = max(
                most.get(name, 0.0), _difference(ours.get(field), theirs.get(field), scales.get(field, 1.0))
            )
    return most


def _lines(written: bytes) -> list[dict[str, Any]]:
    lines = [json.loads(line) for line in written.splitlines()]
    for line in lines:
        del line["calibration_id"]
    return lines


def _scales(line: dict[str, Any]) -> dict[str, Any]:
    """Return the standard deviations of a valid estimate's fields, where it states them; a covariance's are squares."""
    if line.get("status") != "valid":
        return {}
    if line["topic"] == "attitude":  # about no single axis: at first the yaw, arbitrary, has no deviation
        variance = np.array(line["rotation_cov_W_rad2"])[_DIAGONAL].sum()
        return {"q_WB": np.sqrt(variance), "rotation_cov_W_rad2": variance}
    if line["topic"] == "motion":
        velocity, rate = (np.sqrt(np.array(line[name])[_DIAGONAL]) for name in ("velocity_cov_H", "rate_cov_H"))
        return {
            "velocity_H_mps": velocity,
            "rate_H_radps": rate,
            "distance_m": np.sqrt(line["distance_var_m2"]),
            "velocity_cov_H": np.outer(velocity, velocity)[np.triu_indices(3)],
            "rate_cov_H": np.outer(rate, rate)[np.triu_indices(3)],
            "distance_var_m2": line["distance_var_m2"],
        }
    if line["topic"] == "terrain":  # of as many surfaces and edges as were seen
        return {}
    ground = np.sqrt(np.array(line["covariance"])[_DIAGONAL])
    fields = ("slope_sagittal_rad", "slope_frontal_rad", "height_m")
    return {"covariance": np.outer(ground, ground)[np.triu_indices(3)], **dict(zip(fields, ground, strict=True))}


def _difference(ours: Any, theirs: Any, scale: Any = 1.0) -> float:
    if isinstance(ours, dict) and isinstance(theirs, dict):
        fields = ours.keys() | theirs.keys()
        return max((_difference(ours.get(name), theirs.get(name)) for name in fields), default=0.0)
    if _are_parts(ours) and _are_parts(theirs) and len(ours) == len(theirs):
        return max(map(_difference, ours, theirs))
    a, b = np.atleast_1d(ours), np.atleast_1d(theirs)
    if a.dtype == b.dtype == float and a.shape == b.shape:
        return float((np.abs(a - b) / scale).max(initial=0.0))
    return 0.0 if ours == theirs else np.inf


def _are_parts(value: Any) -> bool:
    return isinstance(value, list) and len(value) > 0 and all(isinstance(part, dict) for part in value)


def _is_lost(message: Input) -> bool:
    if isinstance(message, ImuSample):
        return _is_within(message.t_sample_ns, _WITHOUT_IMU_S)
    return isinstance(message, Frame) and _is_within(message.header.t_exposure_ns, _WITHOUT_FRAMES_S)


def _is_within(t_ns: int, span_s: tuple[float, float]) -> bool:
    return span_s[0] <= (t_ns - _START_NS) * 1e-9 < span_s[1]


def _main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.replay.freeze", description=__doc__)
    parser.add_argument("--write", action="store_true", help="freeze what the pipeline makes of the walk now")
    write: bool = parser.parse_args().write
    found = replayed(*frozen_walk())
    print(f"sha256 {hashlib.sha256(found).hexdigest()}, {len(found)} bytes")
    if write:
        FROZEN.write_bytes(gzip.compress(found, mtime=0))
        print(f"frozen in {FROZEN}")
        return
    for field, most in sorted(deviations(found, frozen()).items(), key=lambda item: -item[1])[:5]:
        print(f"{field}: {most:.1e} from the frozen walk")


if __name__ == "__main__":
    _main()
