"""What a minute of walking tells of the camera's place: `python -m benchmarks.mounting`.

Units whose camera stands otherwise than calibrated by 1° (1 σ an axis) and whose stamps are off by 5 ms (1 σ) walk for
a minute; `calibrate mount` has to find both. The camera's steps are told from the truth, without a picture.
"""

import argparse
from dataclasses import replace

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import track as progress

from benchmarks.told_walks import START_NS, attitudes, pace_of
from calib.mount import RIGID, Found, Mounted, brought_near, doubted, mounted
from lab.evaluation.told_steps import OdometerNoise, ToldStep, told_steps
from messages import Calibration, ImuSample, UserError, matrix3
from messages.arrays import BoolArray, FloatArray
from perception import so3
from perception.attitude.track import AttitudeTrack
from sim_rig.walk.legs import Stand
from sim_rig.walk.scenario import Pace, Scenario
from sim_rig.walk.world import WorldBuilder
from sim_rig.wearer import SimulatedWearer

SECONDS = 60.0
_ANGLE_RAD, _LAG_S = np.radians(1.0), 5e-3
_NOISE = OdometerNoise(0.012, float(np.radians(0.4)))


def stop_and_go(pace: Pace) -> Scenario:
    """Return a minute as the command asks for: standing, walking, standing, walking."""
    world = WorldBuilder().level(20.0, "concrete").level(60.0, "asphalt").build()
    legs = (Stand(3.0), pace.to(18.0), Stand(2.0), pace.to(36.0), Stand(2.0), pace.to(75.0), Stand(0.5))
    return Scenario("stop and go", "level ground, with stops", world, legs)


class Trial:
    """One unit, its walk, and the true errors of the calibration that it is given."""

    def __init__(self, seed: int) -> None:
        chance = np.random.default_rng([seed, 23])
        self.wearer = SimulatedWearer(seed, stop_and_go(pace_of(chance)), START_NS)
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
        """Return what two passes find. Raises UserError where they are refused."""
        near = self.given
        first = self._pass(doubted(near, first=True))
        near = brought_near(near, first.mounting)
        return mounted(self.given, near, self._pass(doubted(near, first=False)), f"unit {self._seed}")

    def errors(self, made: Calibration) -> tuple[FloatArray, float]:
        """Return by what (3,) rad and s a calibration's camera and stamps are off."""
        turn = so3.log(np.array(made.X_BL.R) @ np.array(self.wearer.unit.X_BL.R).T)
        return turn, made.stereo.stamp_to_mid_exposure_s - self._true_stamp_s

    def _pass(self, calibration: Calibration) -> Found:
        self.wearer.calibration = calibration
        shift_ns = round(1e9 * (calibration.stereo.stamp_to_mid_exposure_s - self._base.stereo.stamp_to_mid_exposure_s))
        track, samples = AttitudeTrack(calibration, settings=RIGID), self._samples
        steps = (_shifted(told, shift_ns) for told in told_steps(self.wearer, SECONDS, _NOISE, self._seed))
        for _ in attitudes(track, samples, steps):
            pass
        mounting, sensors = track.mounting_errors, track.sensor_errors
        if mounting is None or sensors is None:
            raise UserError(f"unit {self._seed}: {track.reason.value or track.contradiction.value}")
        return Found(mounting, sensors, _mean_temperature(samples))


def _shifted(told: ToldStep, shift_ns: int) -> ToldStep:
    step = told.step
    return replace(
        told,
        step=replace(step, t_before_ns=step.t_before_ns + shift_ns, t_after_ns=step.t_after_ns + shift_ns),
    )


def _mean_temperature(samples: list[ImuSample]) -> float:
    return float(np.mean([sample.temperature_degC for sample in samples]))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mounting", description=__doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(1000, 1299), metavar=("FIRST", "LAST"))
    first, last = parser.parse_args().seeds
    angles, lags, refused = list[FloatArray](), list[float](), 0
    angle_inside, lag_inside = list[BoolArray](), list[bool]()
    stds = list[float]()
    for seed in progress(range(first, last + 1), "walking", console=Console(stderr=True)):
        trial = Trial(seed)
        try:
            found = trial.found()
        except UserError as error:
            refused += 1
            print(error)
            continue
        turn, lag_s = trial.errors(found.calibration)
        angles.append(np.abs(turn))
        lags.append(abs(lag_s))
        angle_inside.append(np.abs(turn) <= 1.96 * found.turn_std)
        lag_inside.append(abs(lag_s) <= 1.96 * found.lag_std)
        stds.append(float(found.turn_std.max()))
    off = np.degrees(np.array(angles))
    print(
        f"units {first} to {last}: {refused} refused; camera to IMU off by {np.sqrt((off**2).mean()):.3f}° RMS, "
        f"{off.max():.3f}° at most, stated {np.degrees(np.mean(stds)):.3f}°, 95 % intervals hold "
        f"{100 * np.mean(angle_inside):.1f} %; stamps off by {1e3 * np.sqrt(np.mean(np.square(lags))):.2f} ms RMS, "
        f"{1e3 * max(lags):.2f} ms at most, intervals hold {100 * np.mean(lag_inside):.1f} %"
    )


if __name__ == "__main__":
    main()
