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
from scipy.interpolate import CubicSpline

from impedance.ankle.mixed_model import Block, MixedFit, Prior, fit
from impedance.ankle.motion import REFLEX_FROM_S, AnkleMotion, Bodies, bodies_of, motion_of
from impedance.ankle.shapes import drift, hats, line_and_bend, spline
from impedance.ankle.trial import AnkleTrial, Instruments, Perturbation
from impedance.ankle.turns import MEAN_SPLINES
from messages.arrays import BoolArray, FloatArray, IntArray, rms
from messages.constants import NORMAL_95
from messages.errors import UserError

AXES: Final = ("dorsi_plantarflexion", "inversion_eversion")
REFLEX_TO_S: Final = 0.40

_IMPEDANCE_SPLINES = 6
_REFLEX_LAGS = 6
_REFLEX_PHASES = 3
_CROSS_SPLINES = 4
_DELAY_ROUNDS = 2
_DELAY_SOUGHT_S = 1e-3
_DELAY_TOLERATED_S = 1e-4
_REFUTED = 5.0
_UNPERTURBED = "events.csv: no cycle is perturbed with the foot flat; nothing tells stiffness from torque"
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
    deviation and its square; `fitted_nm` (m,) is the right side of (1) without e, and `misfit_nm` (m,) that e.
    """

    stiffness: Curve
    damping: Curve
    cross_stiffness: Curve
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
    misfit_nm: FloatArray


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

    def noise_of(self, trial: AnkleTrial, delay_s: float) -> FloatArray:
        """Return e of (1) about both axes in all samples (n, 2) of the trial's wrench, 0 where it is not known.

        The model takes the wrench `delay_s` earlier, and its noise with it, so it is as much later there.
        """
        noise_nm = np.zeros((len(trial.t_s), len(self.axes)))
        noise_nm[self.rows] = np.column_stack([axis.misfit_nm for axis in self.axes])
        for cycle in range(len(trial.perturbation)):
            own = trial.rows_of(cycle)
            t_s = trial.t_s[own]
            noise_nm[own] = CubicSpline(t_s, noise_nm[own])(np.clip(t_s - delay_s, t_s[0], t_s[-1]))
        return noise_nm


def identify(trial: AnkleTrial, points: int = 29) -> AnkleImpedance:
    """Return the impedance at `points` shares of stance; raises UserError where the trial cannot tell it."""
    if all(kind is Perturbation.NONE for kind in trial.perturbation):
        raise UserError(_UNPERTURBED)
    told = trial.settings.instruments
    delay_s, deviation_s, noise_nm = told.delay_s, told.delay_deviation_s, None
    for _ in range(_DELAY_ROUNDS if deviation_s > 0.0 else 0):
        wide_s = max(told.delay_deviation_s, _DELAY_SOUGHT_S)
        seen = _identify_at(_with_delay(trial, delay_s, wide_s), points, Prior.UNIT, noise_nm)
        delay_s, deviation_s = _joined(told, delay_s, wide_s, seen.axes)
        noise_nm = seen.noise_of(trial, delay_s)
    found = _identify_at(_with_delay(trial, delay_s, deviation_s), points, Prior.CONSIDERED, noise_nm)
    return replace(found, delay_s=delay_s, delay_deviation_s=deviation_s)


def _with_delay(trial: AnkleTrial, delay_s: float, deviation_s: float) -> AnkleTrial:
    instruments = msgspec.structs.replace(trial.settings.instruments, delay_s=delay_s, delay_deviation_s=deviation_s)
    return replace(trial, settings=msgspec.structs.replace(trial.settings, instruments=instruments))


def _joined(
    told: Instruments, at_s: float, wide_s: float, axes: tuple[AxisImpedance, AxisImpedance]
) -> tuple[float, float]:
    """Return the delay and its deviation, of what is told of it and of what both axes say about `at_s`.

    The axes were asked with a deviation of `wide_s` before. Raises UserError where they refute what is told.
    """
    information = sum((1.0 / left - 1.0) / wide_s**2 for _, left in (axis.delay for axis in axes))
    pull = sum(value / left / wide_s for value, left in (axis.delay for axis in axes))
    if information > 0.0:
        seen_s, deviation_s = at_s + pull / information, information**-0.5
        unsure_s = float(np.hypot(deviation_s, told.delay_deviation_s))
        if abs(seen_s - told.delay_s) > _DELAY_TOLERATED_S + _REFUTED * unsure_s:
            raise UserError(
                f"trial.toml: both axes tell a delay of the wrench of {1e3 * seen_s:+.3f} ± "
                f"{1e3 * NORMAL_95 * deviation_s:.3f} ms, instruments.delay_s is {told.delay_s:.4g} ± "
                f"{told.delay_deviation_s:.2g} s: cables, rates or filters are not those it was found with"
            )
    before = told.delay_deviation_s**-2
    joined_s = (told.delay_s * before + at_s * information + pull) / (before + information)
    return joined_s, float((before + information) ** -0.5)


def _identify_at(trial: AnkleTrial, points: int, delay_prior: Prior, noise_nm: FloatArray | None) -> AnkleImpedance:
    """Return the impedance with the delay that the trial states: estimated beside it, or considered."""
    bodies = bodies_of(trial.settings)
    motion = motion_of(trial, bodies, noise_nm)
    used = _used(trial, motion)
    if not used.any():
        raise UserError(_UNPERTURBED)
    stance = np.linspace(0.01 * trial.settings.flat_foot.from_percent, _flat_until(trial, motion), points)
    used &= trial.stance[motion.rows] <= stance[-1]
    try:
        first, second = (_identify_axis(trial, motion, bodies, used, axis, stance, delay_prior) for axis in range(2))
    except ValueError as error:
        raise UserError(f"cycles.csv: {error}") from error
    instruments = trial.settings.instruments
    return AnkleImpedance(
        stance, motion.rows[used], (first, second), instruments.delay_s, instruments.delay_deviation_s
    )


def _flat_until(trial: AnkleTrial, motion: AnkleMotion) -> float:
    """Return the share of stance up to which the feet of most steps are flat."""
    told = 0.01 * trial.settings.flat_foot.to_percent
    if trial.heel_rise_m is None:
        return told
    cycle = trial.cycle[motion.rows]
    ends = [float(trial.stance[motion.rows][cycle == c].max()) for c in np.unique(cycle)]
    return min(told, float(np.median(ends)))


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
    x, rate = motion.turns[:, used, axis]
    other_x, other_rate = motion.turns[:, used, 1 - axis]
    shapes = spline(s, span, _IMPEDANCE_SPLINES)
    line, bend = line_and_bend(_IMPEDANCE_SPLINES)
    everywhere = any(kind is Perturbation.RANDOM for kind in trial.perturbation)
    smoothness = Prior.FREE if everywhere else Prior.LEARNT
    across = spline(s, span, _CROSS_SPLINES)
    cross_line, cross_bend = line_and_bend(_CROSS_SPLINES)
    drift_line, drift_bend = drift(trial.t_s[rows], cycle)
    reflex = _reflex(trial, motion, axis, span)[used]
    blocks = [
        Block("stiffness_line", (shapes @ line) * x[:, None], Prior.FREE),
        Block("stiffness_bend", (shapes @ bend) * x[:, None], smoothness),
        Block("damping_line", (shapes @ line) * rate[:, None], Prior.FREE),
        Block("damping_bend", (shapes @ bend) * rate[:, None], smoothness),
        Block("cross_stiffness_line", (across @ cross_line) * other_x[:, None], Prior.FREE),
        Block("cross_stiffness_bend", (across @ cross_bend) * other_x[:, None], Prior.LEARNT),
        Block("cross_damping", (across @ cross_line) * other_rate[:, None], Prior.LEARNT),
        Block("plate", motion.plate_columns[used, axis], Prior.UNIT),
        Block("foot", motion.foot_columns[used, axis], Prior.UNIT),
        Block("delay", motion.delay_columns[used, axis, None], delay_prior),
        Block("gain", motion.gain_columns[used, axis, None], Prior.CONSIDERED),
        Block("crosstalk", motion.crosstalk_columns[used, axis, None], Prior.CONSIDERED),
        Block("lever", motion.lever_columns[used, axis], Prior.CONSIDERED),
        Block("contact", motion.contact_columns[used, axis], Prior.CONSIDERED),
        Block("mean", spline(s, span, MEAN_SPLINES), Prior.FREE),
        Block("drift_line", drift_line, Prior.LEARNT),
        Block("drift_bend", drift_bend, Prior.LEARNT),
        Block("reflex", reflex, Prior.LEARNT),
    ]
    found = fit(motion.moment[used, axis], blocks, cycle)
    delay = (0.0, 1.0)
    if delay_prior is Prior.UNIT:
        delay = (float(found.of("delay")[0][0]), float(found.of("delay")[1][0, 0]))
    asked = spline(stance, span, _IMPEDANCE_SPLINES)
    asked_across = spline(stance, span, _CROSS_SPLINES)
    inertia, inertia_deviation = _foot_inertia(found, bodies, axis)
    parts = {block.name: block.X @ found.of(block.name)[0] for block in blocks if block.name in found.slices}
    perturbed = sum(
        parts[name] for name in parts if name.startswith(("stiffness", "damping", "cross", "plate", "foot"))
    )
    stiffness = _curve(found, "stiffness", np.hstack((asked @ line, asked @ bend)))
    mean = spline(stance, span, MEAN_SPLINES)
    of_fit = np.einsum("ki,ij,kj->k", mean, found.of("mean")[1], mean)
    drift_nm = rms(parts["drift_line"] + parts["drift_bend"])
    reflex_nm = rms(parts["reflex"]) if "reflex" in parts else 0.0
    of_steps = drift_nm**2 / len(np.unique(cycle)) + reflex_nm**2
    moment = Curve(mean @ found.of("mean")[0], np.sqrt(of_fit + of_steps))
    course = _course(motion.angle_rad[used, axis] - x, s, cycle, span, mean)
    return AxisImpedance(
        stiffness=stiffness,
        damping=_curve(found, "damping", np.hstack((asked @ line, asked @ bend))),
        cross_stiffness=_curve(
            found, "cross_stiffness", np.hstack((asked_across @ cross_line, asked_across @ cross_bend))
        ),
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
        misfit_nm=found.residual,
    )


def _course(
    angle_rad: FloatArray, s: FloatArray, cycle: IntArray, span: tuple[float, float], asked: FloatArray
) -> Curve:
    """Return the mean course of an angle (n,) over stance where `asked` (k, splines); steps differ, each by itself."""
    shapes = spline(s, span, MEAN_SPLINES)
    beta = np.linalg.lstsq(shapes, angle_rad, rcond=None)[0]
    deviation = rms(angle_rad - shapes @ beta) / float(np.sqrt(len(np.unique(cycle))))
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
    shares = hats(trial.stance[motion.rows], span, _REFLEX_PHASES)
    columns: FloatArray = (past[:, :, None] * shares[:, None, :]).reshape(len(past), -1)
    return columns


def _foot_inertia(found: MixedFit, bodies: Bodies, axis: int) -> tuple[float, float]:
    """Return the foot's moment about A and its deviation: what was known of the foot and what the data say of it."""
    root, place = bodies.roots[1][_INERTIA_PLACE[axis]], _INERTIA_PLACE[axis]
    beta, covariance = found.of("foot")
    return float(bodies.foot[place] + root @ beta), float(np.sqrt(root @ covariance @ root))


def _curve(found: MixedFit, name: str, shapes: FloatArray) -> Curve:
    """Return a spline's value and deviation from the coefficients of its line and its bends, next to each other."""
    rows = slice(found.slices[f"{name}_line"].start, found.slices[f"{name}_bend"].stop)
    variance = np.einsum("ki,ij,kj->k", shapes, found.covariance[rows, rows], shapes)
    return Curve(shapes @ found.beta[rows], np.sqrt(variance))
