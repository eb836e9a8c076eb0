"""From a frame's arrival to its set-point as frames on CAN: the processor's time of the pipeline and of the encoder.

Of the thread's own time, so that other work of the host does not count; what is not in it is waiting: for an IMU sample
later than the exposure (at most 10 ms, and none where the picture takes longer than that to arrive), for the bus's own
thread, and on a bus of 500 kbit/s 0.27 ms a frame.
"""

import argparse
import time

import numpy as np

from daemon.pipeline import Pipeline
from daemon.setpoints import SetpointSettings, modulator
from messages import Setpoint, Source, Stamp
from messages.can_encoder import CanEncoder
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.terrain_walks import STANDING_S, terrain_walk
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000


def main() -> None:
    """Print the spread over the walks of the chosen seeds."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seeds", type=int, nargs="+", default=[1001, 1002])
    options.add_argument("--seconds", type=float, default=10.0)
    chosen = options.parse_args()
    taken: list[float] = []
    for seed in chosen.seeds:
        taken += _walk(seed, chosen.seconds)
    p50, p99, most = (1e3 * float(each) for each in (*np.percentile(taken, [50, 99]), max(taken)))
    print("| frames | p50, ms | P99, ms | most, ms |")
    print("| ---: | ---: | ---: | ---: |")
    print(f"| {len(taken)} | {p50:.1f} | {p99:.1f} | {most:.1f} |")


def _walk(seed: int, seconds: float) -> list[float]:
    walk = terrain_walk(seed)
    wearer = SimulatedWearer(seed, walk.scenario, START_NS)
    pipeline = Pipeline(wearer.calibration, FootholdSettings(), setpoints=modulator(SetpointSettings(mass_kg=75.0)))
    encoder = CanEncoder()
    stamp = Stamp(device="unit", boot_id="", source=Source.SIMULATED, seq=0, t_publish_ns=0, age_s=0.05)
    taken: list[float] = []
    for message in wearer.offline_inputs(min(seconds, walk.seconds)):
        begun = time.thread_time()
        for estimate in pipeline.step(message):
            if isinstance(estimate, Setpoint) and estimate.t_exposure_ns > START_NS + 1e9 * STANDING_S:
                encoder.setpoint(estimate, stamp, 0.05)
                taken.append(time.thread_time() - begun)
    return taken


if __name__ == "__main__":
    main()
