"""A walk of the rig through the whole pipeline with faults of `lab.faults.message_faults`, which last."""

import numpy as np

from lab.faults.message_faults import KINDS
from lab.faults.offline import FOR_EVER_NS, START_NS, WALKS, OfflineWalk, Strike, struck
from messages import Attitude, GroundPlane
from sim_rig.wearer import SimulatedWearer


def told_since(name: str, seed: int, seconds: float) -> tuple[list[GroundPlane], list[Attitude], SimulatedWearer]:
    """Return what is told from the onset on, after 3.5 to 4 s of the walk; of one fault that is the same trial as
    `fault_trials` has, `A+B` are two, from the same instant on."""
    walk = OfflineWalk(seed, WALKS[seed % len(WALKS)], seconds)
    onset_ns = START_NS + round(1e9 * np.random.default_rng([seed, 4]).uniform(3.5, 4.0))
    chance = np.random.default_rng([seed, *name.encode()])
    chance.integers(2)  # whether it ends, there
    stereo = walk.wearer.unit.stereo
    strikes = [Strike(KINDS[each].draw(chance, stereo), onset_ns, FOR_EVER_NS) for each in name.split("+")]
    pipeline = walk.new_pipeline()
    told = [each for message in struck(walk.inputs, strikes) for each in pipeline.step(message)]
    grounds = [each for each in told if isinstance(each, GroundPlane) and each.t_exposure_ns >= onset_ns]
    attitudes = [each for each in told if isinstance(each, Attitude) and each.t_sample_ns >= onset_ns]
    return [each for each in grounds if each.frame_seq >= 0], attitudes, walk.wearer
