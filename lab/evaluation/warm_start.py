"""A unit that is switched on while its wearer walks: what it gains from what it learnt while the wearer stood."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from daemon.pipeline import Pipeline
from messages import Attitude, Calibration, Frame, GroundPlane, ImuSample, Learnt, Status, Tick, vec3
from messages.arrays import FloatArray
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.legs import Stand, Walk
from sim_rig.walk.scenario import Scenario
from sim_rig.walk.world import WorldBuilder
from sim_rig.wearer import SimulatedWearer

_START_NS = 10_000_000_000
_STAND_S, _SWITCHED_ON_S, _END_S = 7.0, 8.5, 12.0
_OFFSET_RADPS = np.radians((1.0, -0.8, 0.6))
"""How far the gyroscope's bias has gone from its calibration: as between a warm room and a cold street."""


_RigInput = ImuSample | Tick | Frame


class PowerUp(NamedTuple):
    """From power-up, in s: the first valid attitude and ground. The bias's error on the worst axis at the former,
    rad/s; the slope's root mean square error over all valid frames, rad, and how many these are."""

    attitude_s: float
    ground_s: float
    bias_error_radps: float
    slope_rms_rad: float
    frames: int


def warm_start(seed: int) -> tuple[Learnt, PowerUp, PowerUp]:
    """Return what the unit `seed` learns standing for 7 s, and how it starts walking, first without that, then with."""
    ground = WorldBuilder().level(12.0, "concrete").build()
    walk = Scenario("start", "stands, then walks on level ground", ground, (Stand(_STAND_S), Walk(10.0, 1.2, 1.8)))
    wearer = SimulatedWearer(seed, walk, _START_NS)
    imu = wearer.calibration.imu
    aged = msgspec.structs.replace(imu, w_bias_radps=vec3(np.array(imu.w_bias_radps) - _OFFSET_RADPS))
    calibration = msgspec.structs.replace(wearer.calibration, imu=aged)
    inputs = list(wearer.offline_inputs(_END_S))
    first = Pipeline(calibration, FootholdSettings())
    for message in _between(inputs, 0.0, _STAND_S):
        for _ in first.step(message):
            pass
    walking = list(_between(inputs, _SWITCHED_ON_S, _END_S))
    cold, warm = (_started(wearer, calibration, learnt, walking) for learnt in (None, first.learnt))
    return first.learnt, cold, warm


def _started(
    wearer: SimulatedWearer, calibration: Calibration, learnt: Learnt | None, inputs: Sequence[_RigInput]
) -> PowerUp:
    pipeline = Pipeline(calibration, FootholdSettings(), learnt)
    attitude_s = ground_s = bias_error_radps = float("nan")
    squares: list[float] = []
    for message in inputs:
        for estimate in pipeline.step(message):
            if isinstance(estimate, Attitude) and estimate.status is Status.VALID and attitude_s != attitude_s:
                attitude_s = _s(message) - _SWITCHED_ON_S
                off: FloatArray = np.array(estimate.gyro_bias_B_radps) - _bias_radps(wearer, calibration)
                bias_error_radps = float(np.abs(off).max())
            if isinstance(estimate, GroundPlane) and estimate.status is Status.VALID:
                ground_s = _s(message) - _SWITCHED_ON_S if ground_s != ground_s else ground_s
                truth = wearer.truth_of(estimate)
                squares.append((estimate.slope_sagittal_rad - truth.slope_sagittal_rad) ** 2)
    slope_rms_rad = float(np.sqrt(np.mean(squares))) if squares else float("nan")
    return PowerUp(attitude_s, ground_s, bias_error_radps, slope_rms_rad, len(squares))


def _bias_radps(wearer: SimulatedWearer, calibration: Calibration) -> FloatArray:
    """Return what `calibration` leaves of the gyroscope's bias, (3,) in B; its g-sensitivity comes on top."""
    bias: FloatArray = np.array(calibration.imu.w_matrix) @ (
        wearer.unit.chip.w_bias_radps - np.array(calibration.imu.w_bias_radps)
    )
    return bias


def _between(inputs: Sequence[_RigInput], from_s: float, to_s: float) -> Iterator[_RigInput]:
    return (message for message in inputs if from_s <= _s(message) < to_s)


def _s(message: _RigInput) -> float:
    """Return when an input of the rig arrived, since its start."""
    if isinstance(message, ImuSample):
        t_ns = message.t_arrival_ns
    else:
        t_ns = message.t_ns if isinstance(message, Tick) else message.header.t_arrival_ns
    return 1e-9 * (t_ns - _START_NS)
