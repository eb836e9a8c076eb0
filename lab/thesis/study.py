"""The thesis's study on the simulated platform: two runs, instruments, the first estimator, plate first, then foot."""

from dataclasses import dataclass, field, replace

import msgspec
import numpy as np

from impedance.body.kinematics import Kinematics
from impedance.body.rigid_body import Inertia, wrench_transform
from impedance.recording.recording import PlatformRecording, TareSettings
from impedance.thesis.descent import descended
from impedance.thesis.estimator import (
    LinearResidual,
    Variant,
    foot_residual,
    least_residual,
    mass_upright,
    plate_residual,
)
from messages.arrays import FloatArray
from sim_rig.platform.rig import DURATION_S, FOOT, PLATE, THESIS_NOISE, Noise, Rig
from sim_rig.platform.run import SPAN_NM, RunSettings, SimulatedRun, measured, simulate

_UPRIGHT = Kinematics.at_rest(np.array([[0.0, 0.5 * np.pi, 0.0]]))
_LEVEL = Kinematics.at_rest(np.zeros((1, 3)))
_UPRIGHT_SAMPLES = 350


@dataclass(frozen=True)
class Experiment:
    """How both runs are made: the actuators' update rate, shares of their span and of the usual length, `raw` steps."""

    update_hz: float = 40.0
    span: float = 1.0
    length: float = 1.0
    raw: bool = False


@dataclass(frozen=True)
class Treatment:
    """What is done with the runs: by default what the thesis describes, corrected; each other value is one deviation.

    `noise` of the instruments or None. `variant` of the residual. `foot_tared`: the foot stood on the plate at the
    tare. `moments_bounded`: no moment of inertia below zero. `descent_from`: the minima are descended to from this
    share of the true inertia instead of being solved for. `plate_known`: the foot's residual gets the true plate.
    `gains`: what the force plate reads of each component of the truth.
    """

    noise: Noise | None = THESIS_NOISE
    variant: Variant = field(default_factory=Variant)
    foot_tared: bool = False
    moments_bounded: bool = False
    descent_from: float | None = None
    plate_known: bool = False
    gains: tuple[float, ...] = (1.0,) * 6


NOISE_FREE = Treatment(noise=None, variant=Variant(filtered=False))
"""The tables' column "no noise", which the thesis did not filter either."""


@dataclass(frozen=True)
class Runs:
    """The bare plate's run and the one with the foot."""

    plate: SimulatedRun
    foot: SimulatedRun


def run_both(experiment: Experiment, duration_s: float, seed: int) -> Runs:
    """Return both runs; `seed` draws the plate's random steps, and its successor the foot's."""
    settings = RunSettings(
        update_hz=experiment.update_hz,
        duration_s=experiment.length * duration_s,
        span_nm=(experiment.span * SPAN_NM[0], experiment.span * SPAN_NM[1]),
        raw=experiment.raw,
    )
    return Runs(simulate(settings, seed), simulate(replace(settings, rig=Rig(foot=FOOT)), seed + 1))


class Laboratory:
    """Runs of one `seed` and usual length, made once for each experiment, and estimates from them in any noise."""

    def __init__(self, seed: int, duration_s: float = DURATION_S) -> None:
        self.seed, self.duration_s = seed, duration_s
        self._runs: dict[Experiment, Runs] = {}

    def estimated(self, experiment: Experiment, treatment: Treatment, draw: int) -> tuple[Inertia, Inertia]:
        """Return plate and foot as the first estimator finds them in noise number `draw`."""
        if experiment not in self._runs:
            self._runs[experiment] = run_both(experiment, self.duration_s, self.seed)
        return estimated(self._runs[experiment], treatment, (self.seed, draw))


def estimated(runs: Runs, treatment: Treatment, draw: tuple[int, ...]) -> tuple[Inertia, Inertia]:
    """Return plate and foot as the first estimator finds them; `draw` seeds the noise."""
    variant = treatment.variant
    plate_seed, foot_seed, mass_seed = np.random.SeedSequence(draw).generate_state(3).tolist()
    bare = _read(measured(runs.plate, treatment.noise, plate_seed), treatment.gains)
    mass_kg = mass_upright(_upright_readings_n(treatment.noise, mass_seed) * treatment.gains[:3])
    plate = _minimum(plate_residual(bare, variant), mass_kg, PLATE, treatment)

    loaded = measured(runs.foot, treatment.noise, foot_seed)
    if treatment.foot_tared:
        loaded = _tared_with(FOOT, loaded)
    loaded = _read(loaded, treatment.gains)
    residual = foot_residual(loaded, PLATE if treatment.plate_known else plate, variant)
    return plate, _minimum(residual, None, FOOT, treatment)


def _minimum(residual: LinearResidual, mass_kg: float | None, truth: Inertia, treatment: Treatment) -> Inertia:
    bounded, share = treatment.moments_bounded, treatment.descent_from
    if share is None:
        return least_residual(residual, mass_kg, moments_bounded=bounded)
    start = Inertia(share * truth.mass_kg, share * truth.cog_m, share * truth.inertia_kgm2)
    return descended(residual, mass_kg, start, moments_bounded=bounded)


def _upright_readings_n(noise: Noise | None, seed: int) -> FloatArray:
    """Return a second of force readings (n, 3) of the tared plate turned upright."""
    force_n = ((_UPRIGHT.regressor[0] - _LEVEL.regressor[0]) @ PLATE.vector)[:3]
    deviation_n = 0.0 if noise is None else noise.force_n
    readings: FloatArray = force_n + deviation_n * np.random.default_rng(seed).standard_normal((_UPRIGHT_SAMPLES, 3))
    return readings


def _read(recording: PlatformRecording, gains: tuple[float, ...]) -> PlatformRecording:
    return replace(recording, wrench=recording.wrench * gains)


def _tared_with(foot: Inertia, recording: PlatformRecording) -> PlatformRecording:
    """Return the recording as if the foot had stood on the plate at the tare."""
    X_PF = wrench_transform(np.eye(3), np.array(recording.settings.foot.origin_in_plate_m))
    static: FloatArray = X_PF @ _LEVEL.regressor[0] @ foot.vector
    tare = TareSettings(with_foot=True, at_rest=True)
    return replace(
        recording,
        settings=msgspec.structs.replace(recording.settings, tare=tare),
        wrench=recording.wrench - static,
    )
