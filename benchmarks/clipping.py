"""The attitude after samples that were clipped: `python -m benchmarks.clipping [--seeds 31-38]`.

The rig's wearer walks on level ground; for a while the gyroscope's range about y is so small that the walk exceeds it,
and all samples of that time are marked as clipped. What counts is the time from the last of them to the first valid
attitude, and its error in the 3 s from then on.
"""

import argparse

import msgspec
import numpy as np

from daemon.pipeline import Pipeline
from lab.faults.criteria import tilt_error_rad
from messages import Attitude, ImuSample, Status
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
CLIPPED_S = (0.02, 0.04, 0.14, 0.3, 0.6, 1.0)
AT_S = (8.0, 12.3, 16.6, 20.9)
"""Where in the walk the samples are clipped: other phases of the stride, each in a run of its own."""
RANGE_RADPS = 0.2
_JUDGED_S, _PATIENCE_S = 3.0, 8.0


def samples_of(seed: int, seconds: float) -> tuple[SimulatedWearer, list[ImuSample]]:
    """Return one walk's wearer and the samples of its IMU."""
    wearer = SimulatedWearer(seed, scenario("level"), START_NS)
    return wearer, list(wearer.offline_samples(seconds))


def recovery(
    wearer: SimulatedWearer, samples: list[ImuSample], at_s: float, clipped_s: float
) -> tuple[float, list[float]]:
    """Return the seconds until valid, infinite if never, and the tilt errors (rad) in the time that is judged."""
    pipeline = Pipeline(wearer.calibration, FootholdSettings())
    from_ns = START_NS + round(1e9 * at_s)
    to_ns = from_ns + round(1e9 * clipped_s)
    valid_after_s, errors = np.inf, []
    for sample in samples:
        t_ns = sample.t_sample_ns
        if t_ns > to_ns + round(1e9 * (min(_PATIENCE_S, valid_after_s) + _JUDGED_S)):
            break
        if from_ns <= t_ns < to_ns:
            x, y, z = sample.w_WB_B_radps
            limited = (x, max(-RANGE_RADPS, min(y, RANGE_RADPS)), z)
            sample = msgspec.structs.replace(sample, w_WB_B_radps=limited, clipped=True)
        for attitude in pipeline.step(sample):
            if t_ns >= to_ns and isinstance(attitude, Attitude) and attitude.status is Status.VALID:
                valid_after_s = min(valid_after_s, 1e-9 * (t_ns - to_ns))
                errors.append(tilt_error_rad(attitude, wearer.gait.at(np.array([t_ns])).R_WB[0]))
    return valid_after_s, errors


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="31-38", help="rig units, first-last")
    first, last = map(int, parser.parse_args().seeds.split("-"))
    walks = [samples_of(seed, AT_S[-1] + CLIPPED_S[-1] + _PATIENCE_S + _JUDGED_S) for seed in range(first, last + 1)]
    print("clipped for   n   valid again after, s: median  worst   tilt error, °: RMS  worst")
    for clipped_s in CLIPPED_S:
        found = [recovery(*walk, at_s, clipped_s) for walk in walks for at_s in AT_S]
        waits_s = [wait_s for wait_s, _ in found]
        errors_deg = np.degrees(np.concatenate([errors for _, errors in found]))
        print(
            f"{clipped_s:8.2f} s {len(found):4} {np.median(waits_s):28.2f} {max(waits_s):6.2f}"
            f" {np.sqrt(np.mean(errors_deg**2)):19.2f} {errors_deg.max():6.2f}"
        )


if __name__ == "__main__":
    main()
