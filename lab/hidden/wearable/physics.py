"""What is hidden in a wearer's recording, as physics: a unit not as calibrated, a scene not as written."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import msgspec
import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from lab.hidden.case import sign
from lab.hidden.wearable.image_changes import dirty, glossy, locked, moved_right
from lab.hidden.wearable.recording import FRAME_NS, ImageChange, Scene
from messages import Lens, Matrix3, StereoCalibration, matrix3, vec3
from messages.arrays import FloatArray, IntArray
from perception.depth.rectify import Rectifier
from sim_rig.unit import HEIGHT_PX, Unit

Change = Callable[[Scene], Scene]

_structs = msgspec.structs
_RATE_PER_ACCELERATION = 0.05
_ONSET_S = 0.1
_SWING_STEP_NS = 2_000_000


@dataclass(frozen=True)
class Hidden:
    """One cause: the parameters that a verdict must tell, the change it makes, and how the ground bends, if it does."""

    parameters: dict[str, float]
    change: Change
    curvature_per_m: float = 0.0


def hidden(name: str, size: float, random: np.random.Generator) -> Hidden:
    """Return the cause `name` of `size`; what else it needs is drawn from `random`."""
    return _MAKERS[name](size, random)


def _imu_bias(size: float, random: np.random.Generator) -> Hidden:
    kind, axis = str(random.choice(("acc", "gyro"))), int(random.integers(2))
    value = sign(random) * size * (1.0 if kind == "acc" else _RATE_PER_ACCELERATION)
    along = value * np.eye(3)[axis]

    def change(scene: Scene) -> Scene:
        chip = scene.unit.chip
        if kind == "acc":
            chip = replace(chip, sf_bias_mps2=chip.sf_bias_mps2 + chip.sf_matrix @ along)
        else:
            chip = replace(chip, w_bias_radps=chip.w_bias_radps + chip.w_matrix @ along)
        return replace(scene, unit=replace(scene.unit, chip=chip))

    unit = "mps2" if kind == "acc" else "radps"
    return Hidden({f"{kind}_{'xy'[axis]}_{unit}": value}, change)


def _acceleration_disturbance(size: float, random: np.random.Generator) -> Hidden:
    axis, value = int(random.integers(2)), sign(random) * size
    from_s = float(random.uniform(1.2, 3.2))

    def change(scene: Scene) -> Scene:
        def vehicle_W(t_ns: IntArray) -> FloatArray:
            since_s = (np.asarray(t_ns) - scene.first_ns) * 1e-9 - from_s
            return np.outer(0.5 * (1.0 + np.tanh(2.0 * since_s / _ONSET_S)), value * np.eye(3)[axis])

        return replace(scene, vehicle_W_mps2=vehicle_W)

    return Hidden({("ahead_mps2", "left_mps2")[axis]: value}, change)


def _extrinsic_rotation(size: float, random: np.random.Generator) -> Hidden:
    axis, value = int(random.choice((0, 2))), sign(random) * size

    def change(scene: Scene) -> Scene:
        R_LC = Rectifier(scene.told.stereo, 2).R_LC
        turn_L = R_LC @ _turn(axis, value) @ R_LC.T
        X_BL = scene.unit.X_BL
        return replace(
            scene, unit=replace(scene.unit, X_BL=_structs.replace(X_BL, R=matrix3(np.array(X_BL.R) @ turn_L)))
        )

    return Hidden({f"{'xyz'[axis]}_rad": value}, change)


def _time_offset(size: float, random: np.random.Generator) -> Hidden:
    value_s = sign(random) * size

    def change(scene: Scene) -> Scene:
        before = scene.stamp_error_ns
        return replace(scene, stamp_error_ns=lambda k: before(k) + round(value_s * 1e9))

    return Hidden({"value_s": value_s}, change)


def _baseline_error(size: float, random: np.random.Generator) -> Hidden:
    share = sign(random) * size

    def truly(stereo: StereoCalibration) -> StereoCalibration:
        X_RL = stereo.X_RL
        return _structs.replace(stereo, X_RL=_structs.replace(X_RL, p_m=vec3((1.0 + share) * np.array(X_RL.p_m))))

    return Hidden({"share": share}, _with_stereo(truly))


def _focal_error(size: float, random: np.random.Generator) -> Hidden:
    share = sign(random) * size
    return Hidden({"share": share}, _with_stereo(lambda stereo: longer(stereo, share)))


def _toe_in(size: float, random: np.random.Generator) -> Hidden:
    y_rad = sign(random) * size

    def truly(stereo: StereoCalibration) -> StereoCalibration:
        X_RL = stereo.X_RL
        turn: Matrix3 = matrix3(_turn(1, y_rad) @ np.array(X_RL.R))
        return _structs.replace(
            stereo, X_RL=_structs.replace(X_RL, R=turn, p_m=vec3(_turn(1, y_rad) @ np.array(X_RL.p_m)))
        )

    return Hidden({"y_rad": y_rad}, _with_stereo(truly))


def _distortion_residual(size: float, random: np.random.Generator) -> Hidden:
    k1 = sign(random) * size

    def bent(lens: Lens) -> Lens:
        return _structs.replace(lens, distortion=(lens.distortion[0] + k1, *lens.distortion[1:]))

    def truly(stereo: StereoCalibration) -> StereoCalibration:
        return _structs.replace(stereo, left=bent(stereo.left), right=bent(stereo.right))

    return Hidden({"k1": k1}, _with_stereo(truly))


def _motion_blur(size: float, _random: np.random.Generator) -> Hidden:
    return Hidden({"exposure_s": size}, lambda scene: replace(scene, untold_exposure_s=size))


def _rolling_shutter(size: float, _random: np.random.Generator) -> Hidden:
    def change(scene: Scene) -> Scene:
        told_s = max(0.0, scene.unit.stereo.row_time_s - size / HEIGHT_PX)
        return replace(
            scene, told=_structs.replace(scene.told, stereo=_structs.replace(scene.told.stereo, row_time_s=told_s))
        )

    return Hidden({"readout_s": size}, change)


def _pixel_locking(size: float, _random: np.random.Generator) -> Hidden:
    return Hidden(
        {"amplitude_px": size}, lambda scene: _with_image_change(scene, partial(moved_right, shift_px=locked(size)))
    )


def _exposure_change(size: float, random: np.random.Generator) -> Hidden:
    share, period_s, phase = sign(random) * size, float(random.uniform(1.2, 2.5)), float(random.uniform(0.0, 1.0))

    def change(scene: Scene) -> Scene:
        def exposure_s(k: int) -> float:
            light = math.sin(2.0 * math.pi * (k * FRAME_NS * 1e-9 / period_s + phase))
            return 0.0045 + 0.0035 * math.tanh(3.0 * light)  # from sun to shade and back

        mean_s = float(np.mean([exposure_s(k) for k in range(scene.frames)]))
        before = scene.stamp_error_ns
        return replace(
            scene,
            exposure_s=exposure_s,
            stamp_error_ns=lambda k: before(k) + round(share * (exposure_s(k) - mean_s) * 1e9),
        )

    return Hidden({"share": share}, change)


def _texture_bias(size: float, random: np.random.Generator) -> Hidden:
    value = sign(random) * size
    gloss = partial(moved_right, shift_px=glossy(value))
    return Hidden({"per_octave_px": value}, lambda scene: _with_image_change(scene, gloss))


def _ground_not_flat(size: float, random: np.random.Generator) -> Hidden:
    value = sign(random) * size
    return Hidden({"sagittal_per_m": value}, lambda scene: scene, curvature_per_m=value)


def _soft_mount(size: float, random: np.random.Generator) -> Hidden:
    zeta = float(random.uniform(0.12, 0.35))

    def change(scene: Scene) -> Scene:
        return replace(scene, mount_C_rad=_swinging(scene, size, zeta))

    return Hidden({"hz": size}, change)


def _swinging(scene: Scene, hz: float, zeta: float) -> Callable[[IntArray], FloatArray]:
    """Return δ(t) (n, 3) of a camera on a damped spring, integrated from the gait's own rates, in L's axes."""
    t_ns = np.arange(scene.first_ns - 900_000_000, scene.end_ns + 300_000_000, _SWING_STEP_NS)
    rate_L = scene.gait.at(t_ns).w_WB_B_radps @ np.array(scene.unit.X_BL.R)
    acceleration_L = np.gradient(rate_L, t_ns * 1e-9, axis=0)
    omega = 2.0 * math.pi * hz
    s = (t_ns - t_ns[0]) * 1e-9

    def motion(at_s: float, state: FloatArray) -> FloatArray:
        place = min(at_s / (_SWING_STEP_NS * 1e-9), len(s) - 1.001)
        index, share = int(place), place - int(place)
        pushed = (1.0 - share) * acceleration_L[index] + share * acceleration_L[index + 1]
        return np.concatenate((state[3:], -pushed - 2.0 * zeta * omega * state[3:] - omega**2 * state[:3]))

    solved = solve_ivp(
        motion, (0.0, float(s[-1])), np.zeros(6), method="RK45", t_eval=s, max_step=0.01, rtol=1e-5, atol=1e-8
    )

    def turn(at_ns: IntArray) -> FloatArray:
        since_s = (np.asarray(at_ns) - t_ns[0]) * 1e-9
        return np.stack([np.interp(since_s, s, axis) for axis in solved.y[:3]], axis=-1)

    return turn


def _dirty_lens(size: float, random: np.random.Generator) -> Hidden:
    centre = (float(random.uniform(0.35, 0.65)), float(random.uniform(0.5, 0.75)))
    shift_px = sign(random) * size
    return Hidden({"shift_px": shift_px}, lambda scene: _with_image_change(scene, lambda _: dirty(shift_px, centre)))


def _eyes_out_of_step(size: float, _random: np.random.Generator) -> Hidden:
    return Hidden({"lag_s": size}, lambda scene: replace(scene, lag_right_ns=round(size * 1e9)))


def _repeated_frame(size: float, random: np.random.Generator) -> Hidden:
    seed = int(random.integers(1 << 31))

    def change(scene: Scene) -> Scene:
        again = np.random.default_rng([seed, scene.seed]).random(scene.frames) < size
        return replace(scene, shown=lambda k: k - 1 if k > 0 and again[k] else k)

    return Hidden({"share": size}, change)


def _creeping_slope(size: float, random: np.random.Generator) -> Hidden:
    value = sign(random) * size

    def change(scene: Scene) -> Scene:
        def says(t_ns: IntArray, slope: FloatArray, height_m: FloatArray) -> tuple[FloatArray, FloatArray]:
            passed = (np.asarray(t_ns) - scene.first_ns) / (scene.end_ns - scene.first_ns)
            return slope + value * (passed - 0.5), height_m

        return replace(scene, ground_says=says)

    return Hidden({"change_rad": value}, change)


def _lens_breathing(size: float, random: np.random.Generator) -> Hidden:
    period_s, phase = float(random.uniform(0.6, 1.6)), float(random.uniform(0.0, 2.0 * math.pi))

    def change(scene: Scene) -> Scene:
        def unit_at(k: int) -> Unit:
            share = size * math.sin(2.0 * math.pi * k * FRAME_NS * 1e-9 / period_s + phase)
            return replace(scene.unit, stereo=longer(scene.unit.stereo, share))

        return replace(scene, unit_at=unit_at)

    return Hidden({"share": size}, change)


def _vibration(size: float, random: np.random.Generator) -> Hidden:
    hz, phase, axis = float(random.uniform(33.0, 47.0)), float(random.uniform(0.0, 6.28)), int(random.choice((0, 2)))

    def change(scene: Scene) -> Scene:
        def shaken(t_ns: IntArray) -> FloatArray:
            angle = 2.0 * math.pi * hz * (np.asarray(t_ns) - scene.first_ns) * 1e-9 + phase
            return np.outer(size * np.sin(angle), np.eye(3)[axis])

        return replace(scene, mount_C_rad=shaken)

    return Hidden({"amplitude_rad": size}, change)


def _jittering_stamps(size: float, random: np.random.Generator) -> Hidden:
    seed = int(random.integers(1 << 31))

    def change(scene: Scene) -> Scene:
        late_ns = np.random.default_rng([seed, scene.seed]).uniform(-size, size, scene.frames) * 1e9
        return replace(scene, stamp_error_ns=lambda k: round(float(late_ns[k])))

    return Hidden({"most_s": size}, change)


def longer(stereo: StereoCalibration, share: float) -> StereoCalibration:
    """Return the pair with both focal lengths longer by `share`."""

    def lens(told: Lens) -> Lens:
        return _structs.replace(told, fx_px=told.fx_px * (1.0 + share), fy_px=told.fy_px * (1.0 + share))

    return _structs.replace(stereo, left=lens(stereo.left), right=lens(stereo.right))


def _with_stereo(truly: Callable[[StereoCalibration], StereoCalibration]) -> Change:
    return lambda scene: replace(scene, unit=replace(scene.unit, stereo=truly(scene.unit.stereo)))


def _with_image_change(scene: Scene, change: Callable[[Scene], ImageChange]) -> Scene:
    return replace(scene, image_changes=(*scene.image_changes, change))


def _turn(axis: int, angle_rad: float) -> FloatArray:
    R: FloatArray = Rotation.from_rotvec(angle_rad * np.eye(3)[axis]).as_matrix()
    return R


_MAKERS: dict[str, Callable[[float, np.random.Generator], Hidden]] = {
    "imu_bias": _imu_bias,
    "acceleration_disturbance": _acceleration_disturbance,
    "extrinsic_rotation": _extrinsic_rotation,
    "time_offset": _time_offset,
    "baseline_error": _baseline_error,
    "focal_error": _focal_error,
    "toe_in": _toe_in,
    "distortion_residual": _distortion_residual,
    "motion_blur": _motion_blur,
    "rolling_shutter": _rolling_shutter,
    "pixel_locking": _pixel_locking,
    "exposure_change": _exposure_change,
    "texture_bias": _texture_bias,
    "ground_not_flat": _ground_not_flat,
    "soft_mount": _soft_mount,
    "dirty_lens": _dirty_lens,
    "eyes_out_of_step": _eyes_out_of_step,
    "repeated_frame": _repeated_frame,
    "creeping_slope": _creeping_slope,
    "lens_breathing": _lens_breathing,
    "vibration": _vibration,
    "jittering_stamps": _jittering_stamps,
}
