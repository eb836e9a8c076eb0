"""A unit that walks for a minute with a camera that stands otherwise than calibrated: does `calib.mount` find it?"""

from dataclasses import replace

import msgspec
import numpy as np

from calib.mount import RIGID, Course, Found, Mounted, measured
from lab.evaluation.odometer_errors import RenderedErrors
from lab.evaluation.told_steps import OdometerNoise, PairOff, StepErrors, ToldStep, attitudes, pair_off, told_steps
from messages import Calibration, ImuSample, matrix3
from messages.arrays import FloatArray
from perception import so3
from perception.attitude.track import AttitudeTrack
from sim_rig.walk.legs import Stand
from sim_rig.walk.scenario import Pace, Scenario
from sim_rig.walk.world import WorldBuilder
from sim_rig.wearer import SimulatedWearer

_START_NS = 10_000_000_000
SECONDS = 60.0
_ANGLE_RAD, _LAG_S = np.radians(1.0), 5e-3
_NOISE = OdometerNoise(0.012, float(np.radians(0.4)))


def stop_and_go(pace: Pace) -> Scenario:
    """Return a minute as the command asks for: standing, walking, standing, walking."""
    world = WorldBuilder().level(20.0, "concrete").level(60.0, "asphalt").build()
    legs = (Stand(3.0), pace.to(18.0), Stand(2.0), pace.to(36.0), Stand(2.0), pace.to(75.0), Stand(0.5))
    return Scenario("stop and go", "level ground, with stops", world, legs)


class Trial:
    """One unit, its walk, and the true errors of the calibration that it is given.

    `errors` are the odometer's; by default they are drawn for each step, three times as large as those of pictures.
    """

    def __init__(self, seed: int, errors: StepErrors = _NOISE) -> None:
        chance = np.random.default_rng([seed, 23])
        self.wearer = SimulatedWearer(seed, stop_and_go(_pace(chance)), _START_NS)
        self._errors = errors
        self._seed = seed
        self._samples = list(self.wearer.offline_samples(SECONDS))
        self._true_stamp_s = self.wearer.unit.stereo.stamp_to_mid_exposure_s
        self._base = self.wearer.calibration
        turn = so3.exp(chance.normal(0.0, _ANGLE_RAD, 3))
        X_BL = msgspec.structs.replace(self._base.X_BL, R=matrix3(turn @ np.array(self.wearer.unit.X_BL.R)))
        stereo = msgspec.structs.replace(
            self._base.stereo, stamp_to_mid_exposure_s=self._true_stamp_s + float(chance.normal(0.0, _LAG_S))
        )
        self.given = msgspec.structs.replace(self._base, X_BL=X_BL, stereo=stereo)

    def found(self) -> Mounted:
        """Return what `calibrate mount` finds. Raises UserError where it refuses."""
        return measured(self.given, self._pass, f"unit {self._seed}")

    def errors(self, made: Calibration) -> tuple[FloatArray, float]:
        """Return by what (3,) rad and s a calibration's camera and stamps are off."""
        turn = so3.log(np.array(made.X_BL.R) @ np.array(self.wearer.unit.X_BL.R).T)
        return turn, made.stereo.stamp_to_mid_exposure_s - self._true_stamp_s

    def pair_off(self, calibration: Calibration) -> PairOff:
        """Return by what the baseline, the toe-in and with them the distances of a calibration are off."""
        return pair_off(self.wearer.unit, calibration)

    def _pass(self, calibration: Calibration, _: str) -> Found | None:
        self.wearer.calibration = calibration
        shift_ns = round(1e9 * (calibration.stereo.stamp_to_mid_exposure_s - self._base.stereo.stamp_to_mid_exposure_s))
        track, samples, course = AttitudeTrack(calibration, settings=RIGID), self._samples, Course()
        steps = (_shifted(told, shift_ns) for told in told_steps(self.wearer, SECONDS, self._errors, self._seed))
        for attitude in attitudes(track, samples, steps):
            if not course.add(attitude.t_sample_ns, track.mounting_errors):
                return None
        mounting, sensors = track.mounting_errors, track.sensor_errors
        if mounting is None or sensors is None:
            return None
        return Found(mounting, sensors, course.halfway, _mean_temperature(samples))


def rendered_errors(seed: int) -> RenderedErrors:
    """Return what the odometer errs by on the walk of a unit with its true calibration; it is rendered first."""
    walk = stop_and_go(_pace(np.random.default_rng([seed, 23])))
    return RenderedErrors.rendered(SimulatedWearer(seed, walk, _START_NS, perfect_calibration=True), SECONDS)


def _shifted(told: ToldStep, shift_ns: int) -> ToldStep:
    step = told.step
    return replace(
        told,
        step=replace(step, t_before_ns=step.t_before_ns + shift_ns, t_after_ns=step.t_after_ns + shift_ns),
    )


def _mean_temperature(samples: list[ImuSample]) -> float:
    return float(np.mean([sample.temperature_degC for sample in samples]))


def _pace(chance: np.random.Generator) -> Pace:
    speed_mps = chance.uniform(0.8, 1.6)
    return Pace(float(speed_mps), float(1.8 * np.sqrt(speed_mps / 1.2) + chance.normal(0.0, 0.05)))
