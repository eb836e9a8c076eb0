"""Hidden-effect cases of an IMU against a reference motion: recordings in plain files, and the truth apart.

Drawn are a sensor (lab.hidden.imu.sensor), a motion (lab.hidden.imu.motion), rates, noise and gaps. Nothing of
the finder or its plug-ins is used here.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from lab.hidden.case import Case, Kind, Sizes, TrueCause, Truth, log_uniform, sign
from lab.hidden.imu.motion import Curve, Motion, hand_moved, swung
from lab.hidden.imu.sensor import Unit, readings
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2

Drawn = tuple[dict[str, object], dict[str, float]]
"""What an effect changes in a unit, and the parameters that a verdict must tell."""

SIZES: Final[Mapping[str, Sizes]] = {
    "time_offset": Sizes(5e-4, 2e-2, "s"),
    "clock_drift": Sizes(3e-5, 1e-3, "1"),
    "gyro_bias": Sizes(1e-3, 5e-2, "rad/s"),
    "gyro_bias_drift": Sizes(3e-5, 1e-3, "rad/s²"),
    "gyro_scale": Sizes(3e-3, 5e-2, "1"),
    "gyro_misalignment": Sizes(3e-3, 5e-2, "1"),
    "g_sensitivity": Sizes(2e-4, 5e-3, "rad/s/(m/s²)"),
    "acc_bias": Sizes(2e-2, 0.5, "m/s²"),
    "acc_scale": Sizes(3e-3, 5e-2, "1"),
    "acc_misalignment": Sizes(3e-3, 5e-2, "1"),
    "lever_arm": Sizes(5e-3, 8e-2, "m"),
    "frame_rotation": Sizes(np.deg2rad(0.2), np.deg2rad(5.0), "rad"),
    "clipping": Sizes(5e-3, 0.1, "1"),  # share of the samples that touch the limit on some axis
    "low_pass": Sizes(4.0, 30.0, "Hz"),
    "temperature": Sizes(1e-4, 3e-3, "rad/s/°C"),
    "gravity_magnitude": Sizes(1e-2, 0.1, "m/s²"),
    "vibration": Sizes(8.0, 20.0, "Hz"),
    "world_tilt": Sizes(np.deg2rad(0.5), np.deg2rad(5.0), "rad"),
    "axis_skew": Sizes(4e-3, 3e-2, "s"),
    "gyro_hysteresis": Sizes(3e-2, 0.3, "rad/s"),
    "soft_sway": Sizes(1e-3, 1e-2, "rad/(m/s²)"),
    "held_samples": Sizes(5e-3, 5e-2, "1"),
    "cross_coupled_rate": Sizes(1e-3, 1e-2, "s"),
    "size_effect": Sizes(1e-2, 6e-2, "m"),
    "rectified_vibration": Sizes(3e-4, 3e-3, "rad/s/(m/s²)²"),
}
OUTSIDE: Final = (
    "axis_skew",
    "gyro_hysteresis",
    "soft_sway",
    "held_samples",
    "cross_coupled_rate",
    "size_effect",
    "rectified_vibration",
)
EFFECTS: Final = tuple(name for name in SIZES if name not in OUTSIDE)
PAIRS: Final = (
    ("time_offset", "gyro_bias"),
    ("time_offset", "acc_scale"),
    ("time_offset", "lever_arm"),
    ("time_offset", "frame_rotation"),
    ("clock_drift", "gyro_scale"),
    ("clock_drift", "acc_bias"),
    ("gyro_bias", "acc_bias"),
    ("gyro_bias", "gyro_scale"),
    ("gyro_scale", "acc_scale"),
    ("gyro_misalignment", "acc_bias"),
    ("g_sensitivity", "acc_scale"),
    ("lever_arm", "gyro_bias"),
    ("lever_arm", "acc_misalignment"),
    ("frame_rotation", "acc_bias"),
    ("frame_rotation", "gyro_bias"),
    ("clipping", "gyro_bias"),
    ("low_pass", "acc_bias"),
    ("temperature", "gyro_scale"),
    ("gravity_magnitude", "gyro_bias"),
    ("vibration", "gyro_scale"),
)
LOOK_ALIKES: Final = (
    ("time_offset", "clock_drift", "low_pass"),
    ("gyro_bias", "gyro_bias_drift", "temperature", "g_sensitivity"),
    ("acc_bias", "acc_scale", "acc_misalignment", "gravity_magnitude", "world_tilt"),
    ("frame_rotation", "gyro_misalignment", "acc_misalignment"),
)

_AXES: Final = "xyz"
_RATES_HZ: Final = (100.0, 142.857, 200.0, 285.714)
_REFERENCE_RATES_HZ: Final = (100.0, 120.0, 150.0, 200.0)
_FIT_S: Final = 60.0
_HELD_OUT_S: Final = 45.0
_W_LSB_RADPS: Final = float(np.deg2rad(1.0 / 16.4))
_SF_LSB_MPS2: Final = STANDARD_GRAVITY_MPS2 / 2048.0


@dataclass(frozen=True)
class _Nuisance:
    """The nuisance of a case, the same in both recordings."""

    rate_hz: float
    reference_hz: float
    w_noise_radps: float
    sf_noise_mps2: float
    colour: float
    correlation_s: float
    position_noise_m: float
    attitude_noise_rad: float
    jitter: float
    start_degC: float
    warming_degC: float
    swing: float
    gaps: int


def write(case: Case, folder: Path, held_out: Path) -> Truth:
    """Write both recordings of a case and return what they hide; everything follows from the case alone."""
    random = case.stream("effect")
    nuisance = _drawn_nuisance(case.stream("room"))
    motions = {
        purpose: _drawn_curve(case, purpose, nuisance, seconds)
        for purpose, seconds in (("fit", _FIT_S), ("held_out", _HELD_OUT_S))
    }
    changes: dict[str, object] = {}
    causes = []
    for name in case.effects:
        size = SIZES[name].drawn(random)
        change, parameters = _drawn_effect(name, size, random, motions["fit"])
        changes.update(change)
        causes.append(TrueCause(name, parameters, size, SIZES[name].unit))
    unit = Unit(**changes)  # type: ignore[arg-type]
    shares = []
    for purpose, place, seconds in (("fit", folder, _FIT_S), ("held_out", held_out, _HELD_OUT_S)):
        shares.append(_write_one(case, purpose, place, unit, nuisance, motions[purpose], seconds))
    return Truth(
        system="imu",
        seed=case.seed,
        kind=Kind(case.kind),
        causes=tuple(causes),
        nuisance={name: float(value) for name, value in vars(nuisance).items()},
        effect_rms_over_noise=shares[0],
    )


def _drawn_nuisance(random: np.random.Generator) -> _Nuisance:
    level, rate_hz = log_uniform(random, 0.5, 2.0), float(random.choice(_RATES_HZ))
    return _Nuisance(
        rate_hz=rate_hz,
        reference_hz=float(random.choice(_REFERENCE_RATES_HZ)),
        w_noise_radps=level * 1.2e-4 * np.sqrt(0.5 * rate_hz),
        sf_noise_mps2=level * 3.9e-3 * np.sqrt(0.5 * rate_hz),
        colour=float(random.uniform(0.0, 1.0)),
        correlation_s=log_uniform(random, 0.02, 0.5),
        position_noise_m=log_uniform(random, 1e-4, 5e-4),
        attitude_noise_rad=log_uniform(random, 2e-4, 1e-3),
        jitter=float(random.choice((0.0, 0.05))),
        start_degC=float(random.uniform(22.0, 35.0)),
        warming_degC=float(random.uniform(8.0, 20.0)),
        swing=log_uniform(random, 0.7, 1.5),
        gaps=int(random.integers(0, 5)),
    )


def _drawn_curve(case: Case, purpose: str, nuisance: _Nuisance, seconds: float) -> Curve:
    random = case.stream(f"{purpose}/motion")
    swing = nuisance.swing * log_uniform(random, 0.85, 1.2)
    return hand_moved(random, seconds, swing) if random.random() < 0.6 else swung(random, swing)


def _drawn_effect(name: str, size: float, random: np.random.Generator, curve: Curve) -> Drawn:
    vector = _axis_values(size, random)
    axes = np.flatnonzero(vector)

    def told(form: str, values: FloatArray = vector) -> dict[str, float]:
        return {form.format(_AXES[k]): float(values[k]) for k in axes}

    if name in OUTSIDE:
        return {"outside": (name, size * sign(random), int(random.integers(3)))}, {}
    if name == "time_offset":
        late_s = size * sign(random)
        return {"late_s": late_s}, {"value_s": late_s}
    if name == "clock_drift":
        fast = size * sign(random)
        return {"fast": fast}, {"rate": fast}
    if name in ("gyro_misalignment", "acc_misalignment", "g_sensitivity"):
        return _drawn_matrix(name, size, random)
    if name in ("gyro_scale", "acc_scale"):
        return {"w_matrix" if name == "gyro_scale" else "sf_matrix": np.diag(1.0 + vector)}, told("{}")
    if name == "gravity_magnitude":
        gravity = STANDARD_GRAVITY_MPS2 + size * sign(random)
        return {"gravity_mps2": gravity}, {"value_mps2": gravity}
    if name == "world_tilt":
        tilt = _on_two_axes(size, random)
        return {"tilt_rad": tilt}, {"x_rad": float(tilt[0]), "y_rad": float(tilt[1])}
    if name == "low_pass":
        return _drawn_low_pass(size, random)
    if name == "vibration":
        mount_hz = np.full(3, np.inf)
        mount_hz[axes] = size * random.uniform(0.8, 1.25, len(axes))
        return {"mount_hz": mount_hz, "mount_damping": float(random.uniform(0.05, 0.2))}, told("{}_hz", mount_hz)
    if name == "clipping":
        return _drawn_clipping(size, random, curve)
    key, form = {
        "gyro_bias": ("w_bias_radps", "{}_radps"),
        "gyro_bias_drift": ("w_drift_radps2", "{}_radps2"),
        "temperature": ("w_per_degC", "{}_radps_per_degC"),
        "acc_bias": ("sf_bias_mps2", "{}_mps2"),
        "lever_arm": ("arm_m", "{}_m"),
        "frame_rotation": ("turned_rad", "{}_rad"),
    }[name]
    return {key: vector}, told(form)


def _drawn_low_pass(size: float, random: np.random.Generator) -> Drawn:
    which = int(random.integers(3))
    cut_off = (size if which != 1 else np.inf, size * float(random.uniform(0.7, 1.4)) if which != 0 else np.inf)
    pairs = zip(("gyro_hz", "acc_hz"), cut_off, strict=True)
    return {"cut_off_hz": cut_off}, {key: value for key, value in pairs if np.isfinite(value)}


def _drawn_clipping(size: float, random: np.random.Generator, curve: Curve) -> Drawn:
    """Return the limit that a share `size` of the fit recording's samples touches on some axis."""
    motion, t_s = Motion(curve, STANDARD_GRAVITY_MPS2, np.zeros(3)), np.arange(0.5, _FIT_S - 0.5, 0.005)
    if random.random() < 0.5:
        limit = float(np.quantile(np.abs(motion.turning(t_s)).max(axis=1), 1.0 - size))
        return {"w_limit_radps": limit}, {"gyro_radps": limit}
    limit = float(np.quantile(np.abs(motion.specific_force(t_s)).max(axis=1), 1.0 - size))
    return {"sf_limit_mps2": limit}, {"acc_mps2": limit}


def _axis_values(size: float, random: np.random.Generator) -> FloatArray:
    """Return `size` with either sign on one axis, or sizes down to half of it on all three."""
    if random.random() < 0.5:
        shares = sign(random) * np.eye(3)[int(random.integers(3))]
    else:
        shares = random.choice((-1.0, 1.0), 3) * random.permutation((1.0, random.uniform(0.5, 1.0), 0.5))
    values: FloatArray = size * shares
    return values


def _on_two_axes(size: float, random: np.random.Generator) -> FloatArray:
    """Return a level vector (3,) of length `size`."""
    angle = random.uniform(0.0, 2.0 * np.pi)
    return size * np.array((np.cos(angle), np.sin(angle), 0.0))


def _drawn_matrix(name: str, size: float, random: np.random.Generator) -> Drawn:
    allowed = np.ones((3, 3), dtype=bool) if name == "g_sensitivity" else ~np.eye(3, dtype=bool)
    places = np.argwhere(allowed)
    if random.random() < 0.5:
        places = places[[int(random.integers(len(places)))]]
    matrix = np.zeros((3, 3))
    for row, column in places:
        matrix[row, column] = size * sign(random) * (1.0 if len(places) == 1 else random.uniform(0.5, 1.0))
    key = {"g_sensitivity": "w_per_sf", "gyro_misalignment": "w_matrix", "acc_misalignment": "sf_matrix"}[name]
    told = {_AXES[row] + _AXES[column]: float(matrix[row, column]) for row, column in places}
    return {key: matrix if name == "g_sensitivity" else np.eye(3) + matrix}, told


def _write_one(
    case: Case,
    purpose: str,
    folder: Path,
    unit: Unit,
    nuisance: _Nuisance,
    curve: Curve,
    seconds: float,
) -> float:
    """Write one recording; return the RMS of what the causes alter in it, over the noise."""
    noise, reference = case.stream(f"{purpose}/noise"), case.stream(f"{purpose}/reference")
    count = int(seconds * nuisance.rate_hz)
    stamps_s = (np.arange(count) + nuisance.jitter * noise.uniform(-1.0, 1.0, count)) / nuisance.rate_hz
    degC = nuisance.start_degC + nuisance.warming_degC * (1.0 - np.exp(-stamps_s / 25.0)) + np.sin(0.3 * stamps_s)
    ideal = readings(Unit(), curve, stamps_s, degC)
    read = readings(unit, curve, stamps_s, degC)
    deviations = np.repeat((nuisance.w_noise_radps, nuisance.sf_noise_mps2), 3)
    limits = np.repeat((unit.w_limit_radps, unit.sf_limit_mps2), 3)
    altered = float(np.sqrt(np.mean(((np.clip(read, -limits, limits) - ideal) / deviations) ** 2)))
    read = read + deviations * _coloured(noise, (count, 6), nuisance)
    steps = np.repeat((_W_LSB_RADPS, _SF_LSB_MPS2), 3)
    read = steps * np.rint(np.clip(read, -limits, limits) / steps)
    if unit.outside[0] == "held_samples":
        read = _held(read, abs(unit.outside[1]), noise)
    degC = np.rint((degC + 0.03 * noise.standard_normal(count)) * 100.0) / 100.0
    folder.mkdir(parents=True, exist_ok=True)
    _save(
        folder / "imu.csv",
        "t_s,gx_radps,gy_radps,gz_radps,ax_mps2,ay_mps2,az_mps2,temperature_degC",
        np.column_stack((stamps_s, read, degC)),
    )
    _save(folder / "reference.csv", "t_s,qw,qx,qy,qz,px_m,py_m,pz_m", _seen(curve, unit, nuisance, seconds, reference))
    return altered


def _held(read: FloatArray, share: float, random: np.random.Generator) -> FloatArray:
    """Return the readings with bursts of 20 to 80 samples, `share` of all, frozen at the last value before them."""
    read = read.copy()
    for _ in range(max(1, round(share * len(read) / 50.0))):
        first = int(random.integers(len(read) // 20, len(read) - len(read) // 20))
        read[first : first + int(random.integers(20, 81))] = read[first]
    return read


def _coloured(random: np.random.Generator, shape: tuple[int, int], nuisance: _Nuisance) -> FloatArray:
    """Return noise of unit deviation, white but for a part that `colour` weighs and `correlation_s` makes slow."""
    memory = float(np.exp(-1.0 / (nuisance.correlation_s * nuisance.rate_hz)))
    slow = lfilter((np.sqrt(1.0 - memory**2),), (1.0, -memory), random.standard_normal(shape), axis=0)
    found: FloatArray = (random.standard_normal(shape) + nuisance.colour * slow) / np.hypot(1.0, nuisance.colour)
    return found


def _seen(curve: Curve, unit: Unit, nuisance: _Nuisance, seconds: float, random: np.random.Generator) -> FloatArray:
    """Return the reference's rows (m, 8): noisy, and without what the cameras lost."""
    count = int(seconds * nuisance.reference_hz)
    t_s = np.arange(count) / nuisance.reference_hz
    motion = Motion(curve, unit.gravity_mps2, np.zeros(3))
    wrong = Rotation.from_rotvec(nuisance.attitude_noise_rad * random.standard_normal((count, 3)))
    x, y, z, w = (motion.attitude(t_s) * wrong).as_quat().T
    p_m = motion.reference_position(t_s) + nuisance.position_noise_m * random.standard_normal((count, 3))
    rows = np.column_stack((t_s, w, x, y, z, p_m))
    for _ in range(nuisance.gaps):
        first = int(random.integers(count // 20, count - count // 10))
        rows[first : first + int(random.uniform(0.05, 0.5) * nuisance.reference_hz), 1:] = np.nan
    return rows


def _save(path: Path, header: str, rows: FloatArray) -> None:
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=header, comments="")
