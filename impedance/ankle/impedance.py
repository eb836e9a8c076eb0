"""The ankle's intrinsic impedance over stance, on two axes, from ramp or random perturbations of the plate.

About each axis, with x the turn of the foot against the shank away from the cycle's own course and s the share of
stance,

    M_A − Y π̂ = μ(s) + K(s) x + B(s) ẋ + Y δπ + lever δr + d_c(t) + reflex + e                                    (1)

K and B are splines over s, under ramps alone, which leave gaps between them, of a roughness that is learnt; μ, common
to all cycles, is the unperturbed moment; d_c is the slow voluntary and balancing moment of cycle c, a smooth curve
whose strength is learnt; δπ and δr are what the bodies and the ankle's centre may be off, with the deviations told in
the trial; the lever and the wrench's gain are considered only. The wrench's delay τ adds −τ dM/dt: through the known
inertia of plate and foot it looks like no damping, so that both axes tell it; it is taken out, and what stays unknown
of it is considered. The rest is estimated at once (`mixed_model`), so every interval holds them
all.

The intrinsic part is separated from the reflex by time. Of a ramp's cycle only what is measured before `REFLEX_FROM_S`
after the onset is used. Under random perturbation the plate's rate of `REFLEX_FROM_S` to `REFLEX_TO_S` ago, of each
sign, stands in the model as a cause of its own.
"""

from dataclasses import dataclass, replace
from typing import Final

import msgspec
import numpy as np
from scipy.interpolate import BSpline
from scipy.signal import lfilter

from impedance.ankle.mixed_model import Block, MixedFit, Prior, fit
from impedance.ankle.motion import REFLEX_FROM_S, AnkleMotion, Bodies, bodies_of, motion_of
from impedance.ankle.trial import AnkleTrial, Instruments, Perturbation
from messages.arrays import BoolArray, FloatArray, IntArray, rms
from messages.constants import NORMAL_95
from messages.errors import UserError

AXES: Final = ("dorsi_plantarflexion", "inversion_eversion")
REFLEX_TO_S: Final = 0.40

_IMPEDANCE_SPLINES = 6
_MEAN_SPLINES = 16
_REFLEX_LAGS = 6
_REFLEX_PHASES = 3
_DRIFT_KNOT_S = 0.12
_ANSWER_LAGS_S = (0.05, 0.15, 0.5)
_ANSWER_PHASES = 3
_DELAY_ROUNDS = 2
_INERTIA_PLACE = (6, 4)
"""Of J_zz and J_xx about A among a body's ten parameters."""


@dataclass(frozen=True)
class Curve:
    """A value and its standard deviation over stance (k,)."""

    value: FloatArray
    deviation: FloatArray

    @property
    def low(self) -> FloatArray:
        """Return the lower end of the 95 % interval."""
        return self.value - NORMAL_95 * self.deviation

    @property
    def high(self) -> FloatArray:
        """Return the upper end of the 95 % interval."""
        return self.value + NORMAL_95 * self.deviation


@dataclass(frozen=True)
class AxisImpedance:
    """One axis: stiffness (N·m/rad) and damping (N·m·s/rad) over `stance` (k,), the foot's moment of inertia about A.

    `mean_moment` (N·m) is μ of (1), as wide as steps differ and a rectified reflex moves it; `equilibrium` (rad) is the
    angle of foot against shank at which a spring of this stiffness makes no moment, θ̄ − μ / K with θ̄ the mean course of
    the angle: a controller's set-point.

    `noise_nm` is the moment's noise, `drift_nm` the root mean square of the voluntary and balancing moment taken off,
    `reflex_nm` that of the reflex; `accounted` is the share of the perturbed moment's variance that the model accounts
    for, noise and all; `delay` is the wrench's delay beyond the one taken out and its variance, in units of the stated
    deviation and its square; `fitted_nm` (m,) is the right side of (1) without e.
    """

    stiffness: Curve
    damping: Curve
    mean_moment: Curve
    equilibrium: Curve
    inertia_kgm2: float
    inertia_deviation_kgm2: float
    delay: tuple[float, float]
    noise_nm: float
    drift_nm: float
    reflex_nm: float
    accounted: float
    fitted_nm: FloatArray


@dataclass(frozen=True)
class AnkleImpedance:
    """The impedance about both `AXES` over `stance` (k,) from 0 to 1 with the foot flat; `rows` (m,) were used.

    `delay_s` ± `delay_deviation_s` is the wrench's delay behind the motion, as both axes and what was told have it.
    """

    stance: FloatArray
    rows: IntArray
    axes: tuple[AxisImpedance, AxisImpedance]
    delay_s: float
    delay_deviation_s: float


def identify(trial: AnkleTrial, points: int = 29) -> AnkleImpedance:
    """Return the impedance at `points` shares of stance; raises UserError where the trial cannot tell it."""
    told = trial.settings.instruments
    delay_s, deviation_s = told.delay_s, told.delay_deviation_s
    for _ in range(_DELAY_ROUNDS if deviation_s > 0.0 else 0):
        seen = _identify_at(_with_delay(trial, delay_s, told.delay_deviation_s), points, Prior.UNIT)
        delay_s, deviation_s = _joined(told, delay_s, seen.axes)
    found = _identify_at(_with_delay(trial, delay_s, deviation_s), points, Prior.CONSIDERED)
    return replace(found, delay_s=delay_s, delay_deviation_s=deviation_s)


def _with_delay(trial: AnkleTrial, delay_s: float, deviation_s: float) -> AnkleTrial:
    instruments = msgspec.structs.replace(trial.settings.instruments, delay_s=delay_s, delay_deviation_s=deviation_s)
    return replace(trial, settings=msgspec.structs.replace(trial.settings, instruments=instruments))


def _joined(told: Instruments, at_s: float, axes: tuple[AxisImpedance, AxisImpedance]) -> tuple[float, float]:
    """Return the delay and its deviation, of what is told of it and of what both axes say about `at_s`."""
    variance = told.delay_deviation_s**2
    information, pull = 1.0 / variance, told.delay_s / variance
    for axis in axes:
        value, left = axis.delay
        information += (1.0 / left - 1.0) / variance
        pull += (1.0 / left - 1.0) * at_s / variance + value / left / told.delay_deviation_s
    return pull / information, information**-0.5


def _identify_at(trial: AnkleTrial, points: int, delay_prior: Prior) -> AnkleImpedance:
    """Return the impedance with the delay that the trial states: estimated beside it, or considered."""
    bodies = bodies_of(trial.settings)
    motion = motion_of(trial, bodies)
    used = _used(trial, motion)
    if not used.any() or all(kind is Perturbation.NONE for kind in trial.perturbation):
        raise UserError("events.csv: no cycle is perturbed with the foot flat; nothing tells stiffness from torque")
    flat = trial.settings.flat_foot
    stance = np.linspace(0.01 * flat.from_percent, 0.01 * flat.to_percent, points)
    try:
        first, second = (_identify_axis(trial, motion, bodies, used, axis, stance, delay_prior) for axis in range(2))
    except ValueError as error:
        raise UserError(f"cycles.csv: {error}") from error
    instruments = trial.settings.instruments
    return AnkleImpedance(
        stance, motion.rows[used], (first, second), instruments.delay_s, instruments.delay_deviation_s
    )


def _used(trial: AnkleTrial, motion: AnkleMotion) -> BoolArray:
    """Return (n,) of the motion's samples: in a ramp's cycle only those before the reflex."""
    onset_s = np.array(
        [
            at if kind is Perturbation.RAMP else np.inf
            for kind, at in zip(trial.perturbation, trial.onset_s, strict=True)
        ]
    )
    cycle = trial.cycle[motion.rows]
    return trial.t_s[motion.rows] < onset_s[cycle] + REFLEX_FROM_S


def _identify_axis(
    trial: AnkleTrial,
    motion: AnkleMotion,
    bodies: Bodies,
    used: BoolArray,
    axis: int,
    stance: FloatArray,
    delay_prior: Prior,
) -> AxisImpedance:
    rows = motion.rows[used]
    s, cycle = trial.stance[rows], trial.cycle[rows]
    span = (stance[0], stance[-1])
    x, rate = _own_turn(trial, motion, axis)[:, used]
    shapes = spline(s, span, _IMPEDANCE_SPLINES)
    line, bend = _line_and_bend(_IMPEDANCE_SPLINES)
    everywhere = any(kind is Perturbation.RANDOM for kind in trial.perturbation)
    smoothness = Prior.FREE if everywhere else Prior.LEARNT
    drift_line, drift_bend = _drift(trial.t_s[rows], cycle)
    reflex = _reflex(trial, motion, axis, span)[used]
    blocks = [
        Block("stiffness_line", (shapes @ line) * x[:, None], Prior.FREE),
        Block("stiffness_bend", (shapes @ bend) * x[:, None], smoothness),
        Block("damping_line", (shapes @ line) * rate[:, None], Prior.FREE),
        Block("damping_bend", (shapes @ bend) * rate[:, None], smoothness),
        Block("body", motion.body_columns[used, axis], Prior.UNIT),
        Block("delay", motion.delay_columns[used, axis, None], delay_prior),
        Block("gain", motion.gain_columns[used, axis, None], Prior.CONSIDERED),
        Block("lever", motion.lever_columns[used, axis], Prior.CONSIDERED),
        Block("mean", spline(s, span, _MEAN_SPLINES), Prior.FREE),
        Block("drift_line", drift_line, Prior.LEARNT),
        Block("drift_bend", drift_bend, Prior.LEARNT),
        Block("reflex", reflex, Prior.LEARNT),
    ]
    found = fit(motion.moment[used, axis], blocks, cycle)
    delay = (0.0, 1.0)
    if delay_prior is Prior.UNIT:
        delay = (float(found.of("delay")[0][0]), float(found.of("delay")[1][0, 0]))
    asked = spline(stance, span, _IMPEDANCE_SPLINES)
    inertia, inertia_deviation = _foot_inertia(found, bodies, axis)
    parts = {block.name: block.X @ found.of(block.name)[0] for block in blocks if block.name in found.slices}
    perturbed = sum(parts[name] for name in parts if name.startswith(("stiffness", "damping", "body")))
    stiffness = _curve(found, "stiffness", np.hstack((asked @ line, asked @ bend)))
    mean = spline(stance, span, _MEAN_SPLINES)
    of_fit = np.einsum("ki,ij,kj->k", mean, found.of("mean")[1], mean)
    drift_nm = rms(parts["drift_line"] + parts["drift_bend"])
    reflex_nm = rms(parts["reflex"]) if "reflex" in parts else 0.0
    of_steps = drift_nm**2 / len(np.unique(cycle)) + reflex_nm**2
    moment = Curve(mean @ found.of("mean")[0], np.sqrt(of_fit + of_steps))
    course = _course(trial.plate_rad[rows, axis] - trial.shank_rad[rows, axis], s, cycle, span, mean)
    return AxisImpedance(
        stiffness=stiffness,
        damping=_curve(found, "damping", np.hstack((asked @ line, asked @ bend))),
        mean_moment=moment,
        equilibrium=_equilibrium(found, course, stiffness, moment, np.hstack((asked @ line, asked @ bend)), mean),
        inertia_kgm2=inertia,
        inertia_deviation_kgm2=inertia_deviation,
        delay=delay,
        noise_nm=found.sigma,
        drift_nm=drift_nm,
        reflex_nm=reflex_nm,
        accounted=float(1.0 - found.residual.var() / (found.residual + perturbed).var()),
        fitted_nm=motion.moment[used, axis] - found.residual,
    )


def _course(
    angle_rad: FloatArray, s: FloatArray, cycle: IntArray, span: tuple[float, float], asked: FloatArray
) -> Curve:
    """Return the mean course of an angle (n,) over stance where `asked` (k, splines), steps differing as they do."""
    shapes = spline(s, span, _MEAN_SPLINES)
    beta = np.linalg.lstsq(shapes, angle_rad, rcond=None)[0]
    left = angle_rad - shapes @ beta
    counts = np.bincount(cycle)
    offsets = np.bincount(cycle, left)[counts > 0] / counts[counts > 0]
    deviation = float(offsets.std(ddof=1) / np.sqrt(len(offsets))) if len(offsets) > 1 else float(left.std())
    return Curve(asked @ beta, np.full(len(asked), deviation))


def _equilibrium(
    found: MixedFit, course: Curve, stiffness: Curve, moment: Curve, of_stiffness: FloatArray, of_moment: FloatArray
) -> Curve:
    """Return θ̄ − μ / K with its deviation to first order, K and μ as they vary together."""
    rows = slice(found.slices["stiffness_line"].start, found.slices["stiffness_bend"].stop)
    together = found.covariance[rows, found.slices["mean"]]
    shared = np.einsum("ki,ij,kj->k", of_stiffness, together, of_moment)
    K, mu = stiffness.value, moment.value
    variance = (moment.deviation / K) ** 2 + (mu * stiffness.deviation / K**2) ** 2 - 2.0 * mu * shared / K**3
    return Curve(course.value - mu / K, np.sqrt(course.deviation**2 + np.maximum(variance, 0.0)))


def _own_turn(trial: AnkleTrial, motion: AnkleMotion, axis: int) -> FloatArray:
    """Return (2, n): x and ẋ of (1), the plate's turn minus what the shank answers to it.

    The shank's angle is a mean course over the cycles, plus a slow curve of each cycle, plus the answer: the plate's
    turn through second-order lags. Only the answer counts, so a natural step to step change of the shank is no input.
    """
    s, cycle = trial.stance[motion.rows], trial.cycle[motion.rows]
    span = (float(s.min()), float(s.max()))
    plate = motion.plate[:2, :, axis].copy()
    plate[0] -= plate[0].mean()
    answer = np.stack([_lagged(each, cycle, trial.settings.rate_hz) for each in plate])
    columns: FloatArray = (answer[..., None] * _hats(s, span, _ANSWER_PHASES)[:, None, :]).reshape(2, len(s), -1)
    line, bend = _drift(trial.t_s[motion.rows], cycle)
    found = fit(
        motion.shank[0, :, axis],
        [
            Block("answer", columns[0], Prior.LEARNT),
            Block("course", spline(s, span, _MEAN_SPLINES), Prior.FREE),
            Block("drift_line", line, Prior.LEARNT),
            Block("drift_bend", bend, Prior.LEARNT),
        ],
        cycle,
    )
    turn: FloatArray = plate - columns @ found.of("answer")[0]
    return turn


def _lagged(values: FloatArray, cycle: IntArray, rate_hz: float) -> FloatArray:
    """Return (n, 2 lags): values (n,) through 1 / (1 + T p) and 1 / (1 + T p)², p = d/dt, every cycle from rest."""
    columns = np.zeros((len(values), 2 * len(_ANSWER_LAGS_S)))
    for c in np.unique(cycle):
        rows = np.flatnonzero(cycle == c)
        for place, lag_s in enumerate(_ANSWER_LAGS_S):
            keep = np.exp(-1.0 / (lag_s * rate_hz))
            once = lfilter([1.0 - keep], [1.0, -keep], values[rows])
            columns[rows, 2 * place] = once
            columns[rows, 2 * place + 1] = lfilter([1.0 - keep], [1.0, -keep], once)
    return columns


def _hats(s: FloatArray, span: tuple[float, float], count: int) -> FloatArray:
    """Return `count` linear hat functions over `span`, at (n,): (n, count), each row adding up to 1."""
    place = (s - span[0]) / (span[1] - span[0]) * (count - 1)
    hats: FloatArray = np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(count)))
    return hats


def _drift(t_s: FloatArray, cycle: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the columns of every cycle's slow curve: level and slope, and bends."""
    lines: list[FloatArray] = []
    bends: list[FloatArray] = []
    for c in np.unique(cycle):
        rows = np.flatnonzero(cycle == c)
        t = t_s[rows]
        count = max(4, 3 + round((t[-1] - t[0]) / _DRIFT_KNOT_S))
        shapes = spline(t, (t[0], t[-1]), count)
        line, bend = _line_and_bend(count)
        for columns, part in ((lines, shapes @ line), (bends, shapes @ bend)):
            whole = np.zeros((len(t_s), part.shape[1]))
            whole[rows] = part
            columns.append(whole)
    return np.hstack(lines), np.hstack(bends)


def _reflex(trial: AnkleTrial, motion: AnkleMotion, axis: int, span: tuple[float, float]) -> FloatArray:
    """Return the columns of the reflex: past rates of each sign, by lag and by share of stance."""
    rate_hz = trial.settings.rate_hz
    lags = np.arange(round(REFLEX_FROM_S * rate_hz), round(REFLEX_TO_S * rate_hz))
    by_lag = spline(lags.astype(np.float64), (float(lags[0]), float(lags[-1])), _REFLEX_LAGS)
    kernel = np.vstack((np.zeros((lags[0], _REFLEX_LAGS)), by_lag)) / rate_hz
    random = [c for c, kind in enumerate(trial.perturbation) if kind is Perturbation.RANDOM]
    past = np.zeros((len(trial.t_s), 2 * _REFLEX_LAGS if random else 0))
    for c in random:
        rows = trial.rows_of(c)
        rate = motion.all_rates[rows, axis]
        for place, signed in enumerate((np.maximum(rate, 0.0), np.minimum(rate, 0.0))):
            for lag in range(_REFLEX_LAGS):
                past[rows, place * _REFLEX_LAGS + lag] = np.convolve(signed, kernel[:, lag])[: len(rate)]
    past = past[motion.rows]
    hats = _hats(trial.stance[motion.rows], span, _REFLEX_PHASES)
    columns: FloatArray = (past[:, :, None] * hats[:, None, :]).reshape(len(past), -1)
    return columns


def _foot_inertia(found: MixedFit, bodies: Bodies, axis: int) -> tuple[float, float]:
    """Return the foot's moment about A and its deviation: what the data say of plate plus foot, shared by
    covariance."""
    total = bodies.plate_covariance + bodies.foot_covariance
    root = bodies.root
    beta, covariance = found.of("body")
    gain = bodies.foot_covariance @ np.linalg.pinv(total, rcond=1e-13, hermitian=True)
    moved = bodies.foot + gain @ root @ beta
    left = bodies.foot_covariance - gain @ (total - root @ covariance @ root.T) @ gain.T
    place = _INERTIA_PLACE[axis]
    return float(moved[place]), float(np.sqrt(max(left[place, place], 0.0)))


def _curve(found: MixedFit, name: str, shapes: FloatArray) -> Curve:
    """Return a spline's value and deviation from the coefficients of its line and its bends, next to each other."""
    rows = slice(found.slices[f"{name}_line"].start, found.slices[f"{name}_bend"].stop)
    variance = np.einsum("ki,ij,kj->k", shapes, found.covariance[rows, rows], shapes)
    return Curve(shapes @ found.beta[rows], np.sqrt(variance))


def spline(at: FloatArray, span: tuple[float, float], count: int) -> FloatArray:
    """Return `count` cubic B-splines with even knots over `span`, at (n,): (n, count), each row adding up to 1."""
    step = (span[1] - span[0]) / (count - 3)
    knots = span[0] + step * np.arange(-3, count + 1)
    shapes: FloatArray = BSpline.design_matrix(np.clip(at, knots[3], knots[-4]), knots, 3).toarray()
    return shapes


def _line_and_bend(count: int) -> tuple[FloatArray, FloatArray]:
    """Return (count, 2) and (count, count − 2): coefficients of level and slope, and of unit second differences."""
    line = np.column_stack((np.ones(count), np.linspace(-1.0, 1.0, count)))
    second = np.diff(np.eye(count), n=2, axis=0)
    return line, second.T @ np.linalg.inv(second @ second.T)
