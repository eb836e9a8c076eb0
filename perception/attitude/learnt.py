"""What a unit learns of its sensors while the filter runs, and what of that the next start begins with.

The calibration leaves an error e with the variance V₀ about 0. It was measured as m with the variance V; by the next
start it has changed by something of the variance W: turning on, another die temperature, age. As a process that keeps
to N(0, V₀), it is by then

    e ~ N(k m, k² V + (1 − k²) V₀),   1 − k² = min(W / V₀, 1)                        (1)

so that nothing learnt ever makes a start less certain than the calibration does.

Between two die temperatures at which a bias was measured it is interpolated. The farther from both, the less is known:
at T between T₁ and T₂ the distance is

    d = (T − T₁)(T₂ − T) / (T₂ − T₁)                                                 (2)

and beyond the last one, where the other lies infinitely far, |T − T₁|.
"""

import math
from bisect import bisect_left
from dataclasses import dataclass
from operator import attrgetter

import msgspec

from messages import BiasAtTemperature, DepthScale, Learnt, UnitCalibration, UserError, Vec3
from messages.constants import STANDARD_GRAVITY_MPS2
from messages.learnt import DIE_TEMPERATURES_DEGC
from perception import vec3
from perception.attitude.kalman import AttitudeKalman
from perception.attitude.sensor_errors import SensorErrors
from perception.attitude.state import AttitudeSettings


@dataclass(frozen=True, kw_only=True)
class LearningSettings:
    """How far sensors change while nobody measures them, 1 σ, and what is worth keeping.

    `*_turn_on_*` is the change from one power-up to the next at one temperature: the data sheet states none. It
    is on the safe side: a gyroscope's bias that is 2 °/s off what was learnt is still covered when the IMU alone has to
    find out, and a start in motion takes no longer for it. `gyro_radps_per_K` is a third of the change that the
    MPU-6050's data sheet admits over its range, ±20 °/s from −40 to 85 °C; the accelerometer's is the filter's own.
    After `ageing_s` of use the variance of a turn-on has come once more.
    Of a gyroscope's bias nothing is kept whose deviation is above `gyro_known_radps` on any axis, of the depth scale
    nothing above `scale_known_share` of the calibration's deviation, and nothing at all beyond `most_sigmas` of that.
    Biases at one temperature are those of a range of `bin_K`. What is to be learnt has stood for `confirmed_s` in which
    the filter was valid and nothing contradicted it, without a pause longer than `longest_pause_s`.
    """

    gyro_turn_on_radps: float = math.radians(1.0)
    gyro_radps_per_K: float = math.radians(0.1)
    gyro_known_radps: float = math.radians(0.1)
    sf_turn_on_mps2: float = 0.5e-3 * STANDARD_GRAVITY_MPS2
    scale_turn_on: float = 0.001
    scale_known_share: float = 0.5
    ageing_s: float = 360_000.0
    most_sigmas: float = 3.0
    bin_K: float = 2.0
    confirmed_s: float = 2.0
    longest_pause_s: float = 0.5


class SensorLearning:
    """Remembers what the filter finds out about its sensors, and tells a new start what to begin with."""

    def __init__(self, calibration: UnitCalibration, learnt: Learnt | None) -> None:
        """Go on from `learnt`; raises UserError where that does not belong to `calibration`."""
        self.settings = LearningSettings()
        self._sf_per_K_mps2 = calibration.residual.sf_per_K_std_mps2
        self._calibration = calibration
        self._unlearnt = unlearnt(calibration)
        self._learnt = learnt or Learnt(calibration_id=calibration.id)
        check_learnt(self._learnt, calibration)
        self._unconfirmed: tuple[int, float, SensorErrors] | None = None
        self._newest_ns = 0

    @property
    def learnt(self) -> Learnt:
        """Return all that is known by now, of this run and those before it."""
        return self._learnt

    def prior(self, temperature_degC: float) -> SensorErrors:
        """Return what a start at this die temperature begins with, (1); a temperature that is NaN tells no bias."""
        settings, scale = self.settings, self._learnt.depth_scale
        prior = unlearnt(self._calibration, temperature_degC)
        if self._learnt.biases and math.isfinite(temperature_degC):
            found, distance_K = _interpolated(self._learnt.biases, temperature_degC)
            turn_ons = 1.0 + (self._learnt.used_s - found.seen_s) / settings.ageing_s
            gyro = turn_ons * settings.gyro_turn_on_radps**2 + (settings.gyro_radps_per_K * distance_K) ** 2
            sf = turn_ons * settings.sf_turn_on_mps2**2 + (self._sf_per_K_mps2 * distance_K) ** 2
            gyro_bias, gyro_var = _later_axes(found.gyro_bias_radps, found.gyro_std_radps, prior.gyro_var, gyro)
            sf_bias, sf_var = _later_axes(found.sf_bias_mps2, found.sf_std_mps2, prior.sf_var, sf)
            prior = prior._replace(gyro_bias=gyro_bias, gyro_var=gyro_var, sf_bias=sf_bias, sf_var=sf_var)
        if scale is not None:
            turn_ons = 1.0 + (self._learnt.used_s - scale.seen_s) / settings.ageing_s
            value, var = _later(scale.scale, scale.std, prior.scale_var, turn_ons * settings.scale_turn_on**2)
            prior = prior._replace(scale=value, scale_var=var)
        return prior

    def add(self, t_ns: int, temperature_degC: float, found: SensorErrors) -> None:
        """Take what the filter knows at `t_ns`, where it is valid and nothing contradicts it.

        It is learnt with a later one, unless `discard` or a pause comes before: the filter was not valid then, or
        something contradicted it.
        """
        if t_ns - self._newest_ns > 1e9 * self.settings.longest_pause_s:
            self.discard()
        self._newest_ns = t_ns
        if self._unconfirmed is not None:
            since_s = 1e-9 * (t_ns - self._unconfirmed[0])
            if since_s < self.settings.confirmed_s:
                return
            self._learn(since_s, *self._unconfirmed[1:])
        self._unconfirmed = (t_ns, temperature_degC, found)

    def discard(self) -> None:
        """Forget what is not learnt yet: camera and IMU contradict each other."""
        self._unconfirmed = None

    def _learn(self, elapsed_s: float, temperature_degC: float, found: SensorErrors) -> None:
        used_s = self._learnt.used_s + elapsed_s
        biases, scale = self._learnt.biases, self._learnt.depth_scale
        if self._is_known_bias(temperature_degC, found):
            here = BiasAtTemperature(
                temperature_degC=temperature_degC,
                gyro_bias_radps=found.gyro_bias,
                gyro_std_radps=_root(found.gyro_var),
                sf_bias_mps2=found.sf_bias,
                sf_std_mps2=_root(found.sf_var),
                seen_s=used_s,
            )
            others = (each for each in biases if self._bin(each.temperature_degC) != self._bin(temperature_degC))
            biases = tuple(sorted((*others, here), key=attrgetter("temperature_degC")))
        if self._is_known_scale(found):
            scale = DepthScale(scale=found.scale, std=math.sqrt(found.scale_var), seen_s=used_s)
        self._learnt = msgspec.structs.replace(self._learnt, used_s=used_s, biases=biases, depth_scale=scale)

    def _bin(self, temperature_degC: float) -> int:
        return math.floor(temperature_degC / self.settings.bin_K)

    def _is_known_bias(self, temperature_degC: float, found: SensorErrors) -> bool:
        low, high = DIE_TEMPERATURES_DEGC
        known = max(found.gyro_var) <= self.settings.gyro_known_radps**2 and low <= temperature_degC <= high
        unlearnt_here = unlearnt(self._calibration, temperature_degC)
        bounds = (*unlearnt_here.gyro_var, *unlearnt_here.sf_var)
        return known and _is_within((*found.gyro_bias, *found.sf_bias), bounds, self.settings.most_sigmas)

    def _is_known_scale(self, found: SensorErrors) -> bool:
        settings, bound = self.settings, self._unlearnt.scale_var
        known = 0.0 < found.scale_var <= settings.scale_known_share**2 * bound
        return known and _is_within((found.scale,), (bound,), settings.most_sigmas)


def unlearnt(calibration: UnitCalibration, temperature_degC: float = math.nan) -> SensorErrors:
    """Return what the calibration alone leaves of the sensors' errors at a die temperature: the farther that is from
    where the accelerometer's bias was found, the more. One that is NaN, or none of a die, tells nothing."""
    kalman = AttitudeKalman(AttitudeSettings(), calibration.residual)
    found = kalman.sensor_errors(kalman.new_state())
    low, high = DIE_TEMPERATURES_DEGC
    if not low <= temperature_degC <= high:
        return found
    calibrated_degC, std_K = calibration.imu.calibrated_at
    change_var = kalman.sf_per_K_mps2**2 * ((temperature_degC - calibrated_degC) ** 2 + std_K**2)
    x, y, z = found.sf_var
    return found._replace(sf_var=(x + change_var, y + change_var, z + change_var))


def check_learnt(learnt: Learnt, calibration: UnitCalibration) -> None:
    """Raise UserError, in one line, where `learnt` belongs to another calibration or to none that leaves so little."""
    if learnt.calibration_id != calibration.id:
        raise UserError(f"learnt beside calibration {learnt.calibration_id}, the unit's is {calibration.id}")
    bounds, sigmas = unlearnt(calibration), LearningSettings().most_sigmas
    for each in learnt.biases:
        bounds = unlearnt(calibration, each.temperature_degC)
        where = f"at {each.temperature_degC:.1f} °C"
        _check(f"gyro_bias_radps {where}", each.gyro_bias_radps, bounds.gyro_var, sigmas)
        _check(f"sf_bias_mps2 {where}", each.sf_bias_mps2, bounds.sf_var, sigmas)
    if learnt.depth_scale is not None:
        _check("depth_scale", (learnt.depth_scale.scale,), (bounds.scale_var,), sigmas)


def _check(field: str, values: tuple[float, ...], variances: tuple[float, ...], sigmas: float) -> None:
    if not _is_within(values, variances, sigmas):
        most = ", ".join(f"±{sigmas * math.sqrt(variance):.4g}" for variance in variances)
        raise UserError(f"{field} is {', '.join(f'{value:.4g}' for value in values)}; the calibration admits {most}")


def _is_within(values: tuple[float, ...], variances: tuple[float, ...], sigmas: float) -> bool:
    return all(value**2 <= sigmas**2 * variance for value, variance in zip(values, variances, strict=True))


def _later(value: float, std: float, unlearnt_var: float, change_var: float) -> tuple[float, float]:
    """Return mean and variance of (1)."""
    if unlearnt_var <= change_var:
        return 0.0, unlearnt_var
    kept = 1.0 - change_var / unlearnt_var
    return math.sqrt(kept) * value, kept * min(std**2, unlearnt_var) + change_var


def _later_axes(value: Vec3, std: Vec3, unlearnt_var: Vec3, change_var: float) -> tuple[Vec3, Vec3]:
    x, y, z = (_later(v, s, before, change_var) for v, s, before in zip(value, std, unlearnt_var, strict=True))
    return (x[0], y[0], z[0]), (x[1], y[1], z[1])


def _interpolated(biases: tuple[BiasAtTemperature, ...], temperature_degC: float) -> tuple[BiasAtTemperature, float]:
    """Return the biases at a temperature, at least one being known, and the distance (2) to what was measured, K."""
    after = bisect_left(biases, temperature_degC, key=attrgetter("temperature_degC"))
    if after in (0, len(biases)):
        nearest = biases[min(after, len(biases) - 1)]
        return nearest, abs(temperature_degC - nearest.temperature_degC)
    low, high = biases[after - 1], biases[after]
    span_K = high.temperature_degC - low.temperature_degC
    share = (temperature_degC - low.temperature_degC) / span_K
    between = BiasAtTemperature(
        temperature_degC=temperature_degC,
        gyro_bias_radps=vec3.between(low.gyro_bias_radps, high.gyro_bias_radps, share),
        gyro_std_radps=vec3.between(low.gyro_std_radps, high.gyro_std_radps, share),
        sf_bias_mps2=vec3.between(low.sf_bias_mps2, high.sf_bias_mps2, share),
        sf_std_mps2=vec3.between(low.sf_std_mps2, high.sf_std_mps2, share),
        seen_s=min(low.seen_s, high.seen_s),
    )
    return between, share * (1.0 - share) * span_K


def _root(variances: Vec3) -> Vec3:
    x, y, z = map(math.sqrt, variances)
    return (x, y, z)
