"""The finder on a small rig: hidden causes, look-alikes, causes out of the library, and clean data."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from discrepancy import Explanation, explain
from discrepancy.problem import Part
from discrepancy.simulation import Effect, Parameter
from discrepancy.values import predicted
from discrepancy.verdict import Quantity, from_json, to_json
from messages.errors import UserError
from tests.bench.discrepancy_bench import EDGE_S, RATE_HZ, Path, Rig, coloured, forces, measured

_N = 3000
_NOISE_N = 0.3
_TRUE = {
    "delay": ("value_s", 1e-3),
    "lag": ("tau_s", 1.5e-3),
    "gain": ("fz", 0.03),
    "offset": ("fz_n", 0.8),
    "coulomb": ("fx_n", 0.3),
    "damping": ("z_nspm", 6.0),
    "crosstalk": ("fx_from_fz", 0.02),
    "resonance": ("hz", 48.0),
}


def rigs(
    *causes: str, seed: int = 1, withheld: tuple[str, ...] = (), declared: bool = False, fitted: bool = True
) -> tuple[Rig, Rig]:
    """Return a recording to fit and one held out, with other motion and the same causes."""
    rng = np.random.default_rng(seed)
    colour = rng.uniform(0.0, 0.9)
    out = []
    for _ in range(2):
        path = Path.drawn(rng)
        still = measured(path, "", 1.0, _N)
        truth = still + sum(measured(path, cause, 1.0, _N) - still for cause in causes)
        noise = coloured(rng, _N, _NOISE_N, colour)
        std = noise.std(axis=0) if declared else None
        out.append(Rig(path, truth + noise, std, withheld, fitted=fitted))
    return out[0], out[1]


def named(found: Explanation) -> list[str]:
    return [cause.name for cause in found.verdict.causes]


@pytest.mark.parametrize("cause", sorted(_TRUE))
def test_a_hidden_cause_is_named_with_its_size_and_gain(cause: str) -> None:
    # With the mass unknown, more gain on one channel and less on the other are the same.
    found = explain(*rigs(cause, fitted=cause != "gain"), seed=1)
    parameter, value = _TRUE[cause]
    first = found.verdict.causes[0]
    told = first.parameters[parameter]
    assert found.verdict.verdict == "named"
    assert named(found) == [cause]
    assert told.low is not None
    assert told.high is not None
    width = told.high - told.low
    assert abs(value - 0.5 * (told.low + told.high)) < width  # within twice the 95 % interval, as one draw may
    assert width < value
    gain = found.verdict.gain
    assert gain.share_of_excess_removed is None  # the noise is known only from what the extended model leaves
    assert None not in (gain.held_out_nrmse_before, gain.held_out_nrmse_after, gain.noise_floor_nrmse)
    before, after, floor = (
        each**2  # type: ignore[operator]
        for each in (gain.held_out_nrmse_before, gain.held_out_nrmse_after, gain.noise_floor_nrmse)
    )
    assert before - after > 0.9 * (before - floor)


def test_two_causes_at_once() -> None:
    found = explain(*rigs("delay", "coulomb"), seed=1)
    assert named(found) == ["delay", "coulomb"]


def test_what_cannot_be_told_apart_is_declared() -> None:
    found = explain(*rigs("tare"), seed=1)
    first = found.verdict.causes[0]
    assert {first.name, *first.equivalents} >= {"tare", "offset"}
    assert found.verdict.next_experiment is not None


@pytest.mark.parametrize("cause", ["cubic", "gravity_wave", "stiction", "hum"])
def test_a_cause_in_no_library_is_unknown_and_has_a_signature(cause: str) -> None:
    found = explain(*rigs(cause), seed=1)
    assert found.verdict.verdict == "unknown"
    assert found.verdict.causes == []
    assert found.verdict.remainder.present
    signature = found.verdict.remainder.signature
    assert ("fz_n" if cause == "gravity_wave" else "fx_n") in signature.channels
    low, high = signature.band_hz
    assert low is not None
    assert high is not None
    assert (low < 50.0 < high < 52.0 and low > 48.0) if cause == "hum" else low < 36.0


@pytest.mark.parametrize(
    ("size", "elsewhere", "verdict"), [(0.3, 0.3, "unknown"), (0.3, 0, "nothing"), (1, 0, "unknown")]
)
def test_a_little_that_no_cause_explains_is_believed_when_seen_twice(
    size: float, elsewhere: float, verdict: str
) -> None:
    rng = np.random.default_rng(1)
    both = []
    for share in (size, elsewhere):
        path = Path.drawn(rng)
        still = measured(path, "", 1.0, _N)
        truth = still + share * (measured(path, "gravity_wave", 1.0, _N) - still)
        both.append(Rig(path, truth + coloured(rng, _N, _NOISE_N, 0.3)))
    assert explain(both[0], both[1], seed=1).verdict.verdict == verdict


@pytest.mark.parametrize("cause", ["delay", "coulomb"])
def test_a_cause_taken_out_of_the_library_is_unknown(cause: str) -> None:
    withheld = {"delay": ("delay", "lag", "resonance", "damping"), "coulomb": ("coulomb", "damping")}[cause]
    assert explain(*rigs(cause, withheld=withheld), seed=1).verdict.verdict == "unknown"


@pytest.mark.parametrize("seed", range(11, 15))
def test_clean_data_of_unknown_colour_name_nothing(seed: int) -> None:
    found = explain(*rigs(seed=seed), seed=1)
    assert found.verdict.verdict == "nothing"
    assert found.verdict.remainder.signature.channels == []
    assert found.values_after == found.values_before


def test_a_declared_noise_that_is_right_is_not_an_excess() -> None:
    found = explain(*rigs("delay", declared=True), seed=1)
    assert found.after.adequate
    assert np.all(np.abs(found.after.level - 1.0) < 0.05)
    assert found.verdict.noise_from == "stated"
    share = found.verdict.gain.share_of_excess_removed
    assert share is not None
    assert share > 0.9


def test_a_recording_alone_holds_its_last_part_out() -> None:
    fit, _ = rigs("gain", fitted=False)
    found = explain(fit, None, seed=1)
    assert named(found) == ["gain"]
    assert not found.held_out_is_own
    assert len(found.held_out.channels.t_s) == round(0.3 * _N)
    assert found.held_out.channels.t_s[0] == fit.t_s[round(0.7 * _N)]


def test_an_offset_far_above_the_noise_is_not_taken_for_its_colour() -> None:
    found = explain(*(Rig(rig.path, rig.measured + np.array([0.0, 6.0])) for rig in rigs()), seed=1)
    assert named(found) == ["offset"]


def test_gaps_are_bridged() -> None:
    fit, held_out = rigs("delay")
    values = fit.measured.copy()
    values[500:540] = np.nan
    values[::37, 1] = np.nan
    found = explain(Rig(fit.path, values), held_out, seed=1)
    assert named(found) == ["delay"]


def test_only_fits_what_it_is_told() -> None:
    fit, held_out = rigs("delay")
    found = explain(fit, held_out, seed=1, only=("gain", "offset"))
    assert set(named(found)) == {"gain", "offset"}
    with pytest.raises(UserError, match="effect friction: not in the library of rig"):
        explain(fit, held_out, seed=1, only=("friction",))


_DELAY = Parameter("value_s", "s", 0.0, -0.02, 0.02, 2e-5)


@dataclass(frozen=True)
class OtherDelay(Rig):
    """The rig whose delay has other bounds, or a formula that is off by some share of its value."""

    delay: Parameter = _DELAY

    @property
    def effects(self) -> tuple[Effect, ...]:
        return tuple(
            replace(each, parameters=(self.delay,)) if each.name == "delay" else each for each in super().effects
        )


def delay_of(delay: Parameter) -> Quantity:
    fit, held_out = (OtherDelay(rig.path, rig.measured, delay=delay) for rig in rigs("delay"))
    return explain(fit, held_out, seed=1, only=("delay",)).verdict.causes[0].parameters["value_s"]


def test_an_interval_holds_what_the_formula_itself_may_be_off_by() -> None:
    exact, inexact = (delay_of(replace(_DELAY, inexact=share)) for share in (0.0, 0.2))
    assert exact.value == inexact.value
    assert None not in (exact.value, exact.low, exact.high, inexact.low, inexact.high)
    assert exact.high - exact.low < 0.1 * exact.value  # type: ignore[operator]
    assert inexact.high - inexact.low > 0.4 * exact.value  # type: ignore[operator]


def test_no_interval_reaches_beyond_its_parameter_s_bounds() -> None:
    told = delay_of(replace(_DELAY, high=1.005e-3, inexact=0.2))
    assert told.high == pytest.approx(1.005e-3, rel=1e-12)


def test_a_share_of_inexactness_is_refused_beyond_one() -> None:
    with pytest.raises(ValueError, match="inexact"):
        replace(_DELAY, inexact=1.0)


def test_gains_are_told_apart_only_where_the_mass_is_known() -> None:
    first = explain(*rigs("gain"), seed=1).verdict.causes[0]
    assert first.name == "gain"
    assert len(first.parameters) == 1


def test_equal_seeds_give_equal_bytes() -> None:
    first, second = (to_json(explain(*rigs("lag"), seed=7).verdict) for _ in range(2))
    assert first == second
    assert to_json(from_json(first)) == first


def test_a_recording_too_short_is_refused() -> None:
    path = Path.drawn(np.random.default_rng(1))
    t_s = np.arange(60) / RATE_HZ
    with pytest.raises(UserError, match="too few samples"):
        explain(Rig(path, forces(path, t_s)), None, seed=1)


def test_neutral_values_are_the_base_model() -> None:
    fit, _ = rigs()
    edge = round(EDGE_S * RATE_HZ)
    base = predicted(fit, {})[edge:-edge]
    for effect in fit.effects:
        neutral = {effect.qualified(p.name): p.neutral for p in effect.parameters}
        assert np.array_equal(predicted(fit, neutral)[edge:-edge], base)


def test_a_part_predicts_what_the_whole_does() -> None:
    fit, _ = rigs()
    part = Part(fit, 200, 400)
    assert np.array_equal(predicted(part, {"delay.value_s": 1e-3}), predicted(fit, {"delay.value_s": 1e-3})[200:400])
    assert np.array_equal(part.channels.values, fit.measured[200:400])
