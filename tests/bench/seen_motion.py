"""What a camera and an IMU would measure of a simulated walk, without a picture: the truth with noise of their size."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import takewhile

import msgspec
import numpy as np

from messages import Calibration, Pose, Vec3, matrix3, vec3
from perception.motion.bent_distances import Bend
from perception.motion.ego_motion import EgoMotion
from sim_rig.walk.gait import Gait
from sim_rig.walk.scenario import Pace, scenario

START_NS = 10_000_000_000
FRAME_NS = 50_000_000
SAMPLE_NS = 10_000_000
LATENCY_NS = 40_000_000
LAST_NS = START_NS + 10_200_000_000
WALKING_NS = START_NS + 3_700_000_000
"""From here on the wearer of the scenario "level" walks at full pace."""

R_BC = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
P_BC_M = np.array([0.0, 0.06, 0.0])
RATE_NOISE_RADPS = 0.01
VELOCITY_NOISE_MPS = 0.01


@dataclass(frozen=True)
class SampleAt:
    t_ns: int
    sf_B_mps2: Vec3
    w_B_radps: Vec3


def gait(seed: int, name: str = "level") -> Gait:
    return scenario(name, Pace()).gait(seed, START_NS)


def seen(walk: Gait, from_ns: int, to_ns: int, noise: float = 1.0, seed: int = 0) -> EgoMotion:
    """Return the motion of one step; `noise` multiplies what a camera's would be."""
    chance = np.random.default_rng([seed, from_ns // 1000])
    t_ns = np.linspace(from_ns, to_ns, 21).astype(np.int64)
    motion = walk.at(t_ns)
    centre_m = motion.p_WB_m + motion.R_WB @ P_BC_M
    w_B = np.trapezoid(motion.w_WB_B_radps, axis=0) / 20
    v_B = motion.R_WB[0].T @ (centre_m[-1] - centre_m[0]) / (1e-9 * (to_ns - from_ns))
    return EgoMotion(
        t_before_ns=from_ns,
        t_after_ns=to_ns,
        w_C_radps=R_BC.T @ w_B + noise * chance.normal(0.0, RATE_NOISE_RADPS, 3),
        v_C_mps=R_BC.T @ v_B + noise * chance.normal(0.0, VELOCITY_NOISE_MPS, 3),
        covariance=np.diag([RATE_NOISE_RADPS**2] * 3 + [VELOCITY_NOISE_MPS**2] * 3),
        common_rad=0.0,
        tracks=50,
        bend=Bend(np.zeros((2, 2)), np.zeros(2)),
    )


def imu_samples(walk: Gait, from_ns: int, to_ns: int) -> list[SampleAt]:
    """Return the samples of a perfect IMU."""
    times_ns = np.arange(from_ns, to_ns, SAMPLE_NS)
    sf_B, w_B = walk.imu(times_ns)
    return [SampleAt(int(t), vec3(sf), vec3(w)) for t, sf, w in zip(times_ns, sf_B, w_B, strict=True)]


@cache
def arrivals(seed: int, name: str = "level") -> tuple[SampleAt | EgoMotion, ...]:
    """Return samples and steps since the start in the order of arrival: a step arrives one frame late."""
    walk = gait(seed, name)
    arrived: list[SampleAt | EgoMotion] = []
    due_ns = START_NS + FRAME_NS
    for sample in imu_samples(walk, START_NS, LAST_NS):
        arrived.append(sample)
        while due_ns + FRAME_NS + LATENCY_NS <= sample.t_ns:
            arrived.append(seen(walk, due_ns - FRAME_NS, due_ns, seed=seed))
            due_ns += FRAME_NS
    return tuple(arrived)


def arrivals_until(to_ns: int, seed: int, name: str = "level") -> Iterator[SampleAt | EgoMotion]:
    """Yield what has arrived before `to_ns`."""
    return takewhile(lambda each: isinstance(each, EgoMotion) or each.t_ns < to_ns, arrivals(seed, name))


def calibration_of_the_camera(unit: Calibration) -> Calibration:
    """Return the calibration of a unit whose left camera is where `seen` has it."""
    return msgspec.structs.replace(unit, X_BL=Pose(R=matrix3(R_BC), p_m=vec3(P_BC_M)))
