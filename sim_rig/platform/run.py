"""One run of the simulated platform, and what its instruments record of it.

The model runs at 3500 Hz. Motion and wrench pass the same linear-phase low pass before every tenth sample is kept, as
an instrument's anti-alias filter would have it; `raw` leaves that filter and the actuators' own dynamics out: the
torque steps then alias into the wrench.
"""

from dataclasses import dataclass, field
from typing import Final

import mujoco
import numpy as np
from mujoco import rollout
from scipy.signal import firwin, upfirdn

from impedance.body import geometry
from impedance.body.kinematics import Kinematics
from impedance.body.rigid_body import Inertia
from impedance.recording.recording import (
    FootSettings,
    NoiseSettings,
    PlateSettings,
    PlatformRecording,
    PlatformSettings,
    Poses,
    RateSettings,
    TareSettings,
    Truth,
)
from messages.arrays import FloatArray
from sim_rig.platform import rig as laboratory
from sim_rig.platform.excitation import Excitation, random_steps
from sim_rig.platform.model import SENSORS, model_of
from sim_rig.platform.rig import Noise, Rig

OVERSAMPLING: Final = 10
STEP_S: Final = 1.0 / (OVERSAMPLING * laboratory.MOTION_HZ)
SPAN_NM: Final = (220.0, 120.0)
"""Full span of the actuators' torque about Z and X: the bare plate swings by 0.5° rms then, and 1.5° at most."""
_ANTI_ALIAS_TAPS: Final = 401
_ANTI_ALIAS_HZ: Final = 145.0
_SETTLE_S: Final = 0.5


@dataclass(frozen=True)
class RunSettings:
    """What runs: the rig, and random steps at `update_hz` of ± `span_nm` about Z and X, or else an `excitation`.

    An excitation's time counts from the first sample on.
    """

    rig: Rig = field(default_factory=Rig)
    update_hz: float = 40.0
    duration_s: float = laboratory.DURATION_S
    span_nm: tuple[float, float] = SPAN_NM
    excitation: Excitation | None = None
    raw: bool = False


@dataclass(frozen=True)
class SimulatedRun:
    """What happened, free of noise and tare, at `t_s` (n,), 350 Hz, behind the anti-alias filter.

    `angles_rad` (n, 2) are the joint's (θ, φ), `wrench` (n, 6) is the whole one in P, `kinematics` the exact motion of
    P.
    """

    settings: RunSettings
    seed: int
    t_s: FloatArray
    angles_rad: FloatArray
    plate: Poses
    foot: Poses | None
    wrench: FloatArray
    kinematics: Kinematics

    @property
    def truth(self) -> Truth:
        """Return what no estimator may know."""
        rig, settings = self.settings.rig, self.settings
        return Truth.of(rig.plate, rig.foot, None if settings.excitation else settings.update_hz, self.seed)


def simulate(settings: RunSettings, seed: int) -> SimulatedRun:
    """Return a run from rest; `seed` draws the random steps. Half a second passes before the first sample."""
    rig, raw = settings.rig, settings.raw
    model = model_of(rig, STEP_S, direct=raw)
    margin_s = _SETTLE_S + STEP_S * (_ANTI_ALIAS_TAPS // 2)
    steps = round((settings.duration_s + 2.0 * margin_s) / STEP_S)
    fine_s = STEP_S * np.arange(steps, dtype=np.float64) - margin_s
    excitation = settings.excitation or random_steps(settings.update_hz, settings.span_nm, STEP_S * steps, seed)
    torque_nm = excitation(fine_s + 0.5 * STEP_S)
    sensors = _rolled_out(model, torque_nm)
    angles = sensors[:, SENSORS["angles"]]
    p_m, euler_rad = geometry.joint_pose(angles[:, 0], angles[:, 1], rig.joint_to_surface_m)
    R_IP = geometry.rotation_IP(*euler_rad.T)
    alpha: FloatArray = (sensors[:, None, SENSORS["alpha_I"]] @ R_IP)[:, 0]
    g_P = geometry.GRAVITY_I_MPS2 @ R_IP
    channels = [p_m, euler_rad, sensors[:, SENSORS["wrench"]], sensors[:, SENSORS["specific_force"]] + g_P]
    channels += [sensors[:, SENSORS["w"]], alpha, g_P]
    if rig.foot is not None:
        channels.append(p_m + R_IP @ np.array(rig.foot_origin_m))
    first = round(_SETTLE_S / STEP_S)
    kept = _sampled(np.hstack(channels)[first:], raw)[: round(settings.duration_s * laboratory.MOTION_HZ)]
    p, euler, force, moment, a_O, w, alpha_P, g, *foot_p = (kept[:, k : k + 3] for k in range(0, kept.shape[1], 3))
    return SimulatedRun(
        settings=settings,
        seed=seed,
        t_s=np.arange(len(kept)) / laboratory.MOTION_HZ,
        angles_rad=euler[:, 1:],
        plate=Poses(p, euler),
        foot=Poses(foot_p[0], euler) if foot_p else None,
        wrench=np.hstack((force, moment)),
        kinematics=Kinematics(a_O, w, alpha_P, g),
    )


def measured(
    run: SimulatedRun, noise: Noise | None = laboratory.THESIS_NOISE, seed: int = 0, plate: Inertia | None = None
) -> PlatformRecording:
    """Return what the laboratory records of a run: tared by the bare plate at rest, with a draw of `noise`, or without.

    `plate` is the plate's inertia as an earlier run measured it; the recording carries it in its settings. The
    plate's mass is known in any case. Drawing anew costs no simulation.
    """
    rig = run.settings.rig
    deviations = noise or Noise(0.0, 0.0, 0.0, 0.0)
    rng = np.random.default_rng(seed)
    pose_std = np.repeat((deviations.position_m, deviations.angle_rad), 3)
    wrench_std = np.repeat((deviations.force_n, deviations.torque_nm), 3)

    def seen(poses: Poses) -> Poses:
        return Poses.from_columns(poses.columns + pose_std * rng.standard_normal((len(run.t_s), 6)))

    wrench = run.wrench - bare_plate_tare(rig) + wrench_std * rng.standard_normal(run.wrench.shape)
    return PlatformRecording(
        settings=PlatformSettings(
            rates=RateSettings(motion_hz=laboratory.MOTION_HZ, force_hz=laboratory.MOTION_HZ),
            plate=PlateSettings(
                mass_kg=rig.plate.mass_kg if plate is None else plate.mass_kg,
                joint_to_surface_m=rig.joint_to_surface_m,
                cog_m=None if plate is None else tuple(plate.cog_m.tolist()),
                inertia_kgm2=None if plate is None else tuple(plate.about_cog().tolist()),
            ),
            foot=FootSettings(present=rig.foot is not None, origin_in_plate_m=rig.foot_origin_m),
            tare=TareSettings(at_rest=True),
            noise=NoiseSettings()
            if noise is None
            else NoiseSettings(
                position_m=noise.position_m,
                angle_rad=noise.angle_rad,
                force_n=noise.force_n,
                torque_nm=noise.torque_nm,
            ),
        ),
        t_s=run.t_s,
        plate=seen(run.plate),
        foot=None if run.foot is None else seen(run.foot),
        force_t_s=run.t_s,
        wrench=wrench,
    )


def anti_alias_taps() -> FloatArray:
    """Return the linear-phase low pass of an instrument's anti-alias filter, at the model's rate."""
    taps: FloatArray = firwin(_ANTI_ALIAS_TAPS, _ANTI_ALIAS_HZ, window=("kaiser", 8.0), fs=1.0 / STEP_S)
    return taps


def bare_plate_tare(rig: Rig) -> FloatArray:
    """Return the wrench (6,) of the bare plate at rest and level: what the tare takes away."""
    tare: FloatArray = Kinematics.at_rest(np.zeros((1, 3))).regressor[0] @ rig.plate.vector
    return tare


def _rolled_out(model: mujoco.MjModel, torque_nm: FloatArray) -> FloatArray:
    """Return the sensor data (n, 19) before each step, from rest, under the torques (n, 2) that hold during it."""
    data = mujoco.MjData(model)
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    start = np.empty(size)
    mujoco.mj_getState(model, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    _, sensors = rollout.rollout(model, data, start, torque_nm[None])
    found: FloatArray = sensors[0]
    return found


def _sampled(fine: FloatArray, raw: bool) -> FloatArray:
    """Return every tenth of the samples (n, c), the anti-alias filter's half width on; unfiltered if `raw`."""
    if raw:
        return fine[_ANTI_ALIAS_TAPS // 2 :: OVERSAMPLING]
    kept: FloatArray = upfirdn(anti_alias_taps(), fine, down=OVERSAMPLING, axis=0)[_ANTI_ALIAS_TAPS // OVERSAMPLING :]
    return kept
