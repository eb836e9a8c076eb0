"""The thesis's two experiments on the rig: the camera still before ramps, and a walk; errors split by cause.

All variants see the same inputs in lock-step: one whole pipeline for each cause that a calibration or a stamp can hold,
and the ground alone for what the true attitude or the true depth leaves.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

import msgspec
import numpy as np

from daemon.pipeline import Pipeline
from lab.evaluation.causes.ledger import AS_MEASURED, Ledger, SlopeError
from lab.evaluation.causes.names import BLUR, CAMERA, DEPTH, EXTRINSIC, IMU, ORIENTATION, SYNCHRONISATION
from lab.evaluation.causes.seen_plane import error_of, error_of_attitude
from lab.evaluation.causes.told import ToldAttitudes
from lab.evaluation.offline import known_camera
from messages import Attitude, Frame, GroundPlane, GroundTruth, Input, Status, UnitCalibration, vec3
from messages.arrays import FloatArray
from perception.ground.estimator import GroundEstimator
from perception.ground.foothold import FootholdSettings
from sim_rig.camera.renderer import Effects
from sim_rig.depth_wearer import DepthWearer
from sim_rig.unit import draw_unit
from sim_rig.walk.gait import Gait
from sim_rig.walk.legs import Stand
from sim_rig.walk.scenario import Scenario, scenario
from sim_rig.walk.world import WorldBuilder
from sim_rig.wearer import SimulatedWearer

Wearer = SimulatedWearer | DepthWearer

STATIC = {
    IMU: "its true bias and scale",
    ORIENTATION: "the true attitude",
    DEPTH: "the true plane",
    CAMERA: "its true values",
    EXTRINSIC: "the true rotation",
}
WALKING = {
    **STATIC,
    SYNCHRONISATION: "the true time of exposure",
    BLUR: "sharp pictures",
}
"""What stands in for each cause."""

_START_NS = 10_000_000_000
_RAMP_M = 8.0
_FOOTHOLD = FootholdSettings()


def stand_before(slope_deg: float, seconds: float) -> Scenario:
    """Return a wearer who stands, and sways a little, on a ramp."""
    world = WorldBuilder().ramp(_RAMP_M, slope_deg, "brick").ramp(_RAMP_M, -slope_deg, "brick").build()
    return Scenario("static", f"standing on {slope_deg:g}°", world, (Stand(seconds),))


def static(seed: int, slopes_deg: Sequence[float], seconds: float, camera: str, ledger: Ledger) -> None:
    """Let one unit look at each slope for `seconds`. Raises UserError for an unknown kind of camera."""
    for slope_deg in slopes_deg:
        _run(seed, stand_before(slope_deg, seconds), seconds, camera, ledger, (seed, slope_deg))


def walking(seed: int, name: str, seconds: float, camera: str, ledger: Ledger) -> None:
    """Let one unit walk a scenario, and once more with sharp pictures. Raises UserError for an unknown kind of camera.

    A depth camera's pictures have no motion blur.
    """
    walk = scenario(name)
    _run(seed, walk, seconds, camera, ledger, (seed,))
    if known_camera(camera) is SimulatedWearer:
        sharp = SimulatedWearer(seed, walk, _START_NS, effects=Effects(motion_blur=False))
        variant = _Measured(BLUR, sharp.calibration)
        _feed(sharp, seconds, [variant], ledger, (seed,))


def _run(seed: int, walk: Scenario, seconds: float, camera: str, ledger: Ledger, name: tuple[object, ...]) -> None:
    wearer = known_camera(camera)(seed, walk, _START_NS)
    _feed(wearer, seconds, _variants(wearer, seed), ledger, name)


def _variants(wearer: Wearer, seed: int) -> list["_Variant"]:
    """Return a variant for each cause but blur; the calibration's stated residual is the same in all."""
    stated, true_imu, replace = wearer.calibration, draw_unit(seed).exact_calibration().imu, msgspec.structs.replace
    measured = _Measured(AS_MEASURED, stated)
    variants: list[_Variant] = [
        measured,
        _Measured(IMU, replace(stated, imu=true_imu)),
        _TrueAttitude(ORIENTATION, stated, wearer.gait),
        _Measured(SYNCHRONISATION, stated, wearer.shutter.true_of),
    ]
    if isinstance(wearer, SimulatedWearer):
        stereo = replace(wearer.unit.stereo, stamp_to_mid_exposure_s=stated.camera.stamp_to_mid_exposure_s)
        variants += [
            _Measured(CAMERA, replace(stated, stereo=stereo)),
            _Measured(EXTRINSIC, replace(stated, X_BL=wearer.unit.X_BL)),
            _TrueDepth(DEPTH, measured, wearer, np.array(wearer.unit.X_BL.R)),
        ]
    else:
        variants += [
            _Measured(EXTRINSIC, replace(stated, X_BD=wearer.unit.X_BD)),
            _TrueDepth(DEPTH, measured, wearer, np.array(wearer.unit.X_BD.R)),
        ]
    return variants


def _feed(
    wearer: Wearer, seconds: float, variants: Sequence["_Variant"], ledger: Ledger, name: tuple[object, ...]
) -> None:
    """Give every variant the same inputs; count the frames whose region has no edge."""
    truths: dict[int, GroundTruth] = {}
    for message in wearer.offline_inputs(seconds):
        if isinstance(message, Frame):
            truths[message.header.seq] = wearer.truth(
                message.header.t_exposure_ns, _FOOTHOLD.ahead_m, _FOOTHOLD.half_length_m
            )
        for variant in variants:
            for seq, error in variant.errors(message, truths):
                if not truths[seq].transition:
                    ledger.add(variant.name, (*name, seq), error)


class _Variant(Protocol):
    """One way to tell the ground; `errors` yields number and error of each frame that a message completes."""

    name: str

    def errors(self, message: Input, truths: dict[int, GroundTruth]) -> Iterator[tuple[int, SlopeError]]: ...


class _Measured:
    """The whole pipeline with a calibration; `true_of` puts the stamps of its frames right."""

    def __init__(
        self, name: str, calibration: UnitCalibration, true_of: Callable[[int], int] = lambda t_ns: t_ns
    ) -> None:
        self.name = name
        self.R_BE = np.array(calibration.X_BE.R)
        self.attitudes = ToldAttitudes()
        self.newest: GroundPlane | None = None
        self._true_of = true_of
        self._pipeline = Pipeline(calibration, _FOOTHOLD)

    def errors(self, message: Input, truths: dict[int, GroundTruth]) -> Iterator[tuple[int, SlopeError]]:
        self.newest = None
        if isinstance(message, Frame):
            header = message.header
            header = msgspec.structs.replace(header, t_exposure_ns=self._true_of(header.t_exposure_ns))
            message = msgspec.structs.replace(message, header=header)
        for estimate in self._pipeline.step(message):
            if isinstance(estimate, Attitude):
                self.attitudes.add(estimate)
            elif isinstance(estimate, GroundPlane) and estimate.status is Status.VALID:
                self.newest = estimate
                yield estimate.frame_seq, error_of(estimate, truths[estimate.frame_seq])


class _TrueAttitude:
    """The ground of each frame with the attitude that a perfect IMU would tell for its stamp."""

    def __init__(self, name: str, calibration: UnitCalibration, gait: Gait) -> None:
        self.name = name
        self._gait = gait
        self._ground = GroundEstimator(calibration, _FOOTHOLD)

    def errors(self, message: Input, truths: dict[int, GroundTruth]) -> Iterator[tuple[int, SlopeError]]:
        if not isinstance(message, Frame):
            return
        motion = self._gait.at(np.array([message.header.t_exposure_ns]))
        told = self._ground.estimate(message, motion.R_WB[0], vec3(motion.w_WB_B_radps[0]), np.zeros((3, 3)))
        if told.status is Status.VALID:
            yield told.frame_seq, error_of(told, truths[told.frame_seq])


class _TrueDepth:
    """The true plane, turned by what `measured` knows of attitude, mounting and time at the same frame."""

    def __init__(self, name: str, measured: _Measured, wearer: Wearer, true_R_BE: FloatArray) -> None:
        self.name = name
        self._measured = measured
        self._wearer = wearer
        self._true_R_BE = true_R_BE

    def errors(self, _message: Input, truths: dict[int, GroundTruth]) -> Iterator[tuple[int, SlopeError]]:
        ground = self._measured.newest
        if ground is None:
            return
        told = self._measured.attitudes.at(ground.t_exposure_ns)
        if told is None:
            return
        true_ns = self._wearer.shutter.true_of(ground.t_exposure_ns)
        true_R_WB = self._wearer.gait.at(np.array([true_ns])).R_WB[0]
        truth = truths[ground.frame_seq]
        error = error_of_attitude(told.R_WB @ self._measured.R_BE, true_R_WB @ self._true_R_BE, truth)
        if error is not None:
            yield ground.frame_seq, error
