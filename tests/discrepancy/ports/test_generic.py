"""The generic library: neutral is nothing, every effect does something, and a hidden one is found again."""

from dataclasses import replace

import numpy as np
import pytest

from discrepancy import explain
from discrepancy.ports.declared import Port, Signal, SignalTerm
from discrepancy.ports.friction import friction
from discrepancy.ports.ranges import PortSpan, Span
from discrepancy.ports.restoring import restoring
from discrepancy.ports.timing import lost
from discrepancy.restricted import without
from discrepancy.simulation import Effect
from discrepancy.values import predicted
from tests.bench.ported import hiding, measuring, sled


def strong(effect: Effect) -> dict[str, float]:
    """Return values with which an effect does much: at its first start, all else a fifth of the way to its bounds."""
    start = effect.starts[0] if effect.starts else {}
    values = {}
    for p in effect.parameters:
        far = p.high if np.isfinite(p.neutral) else p.low
        away = p.neutral + 0.2 * (far - p.neutral) if np.isfinite(p.neutral) else p.neutral
        values[effect.qualified(p.name)] = float(start.get(p.name, away))
    return values


def test_the_library_is_as_large_as_the_places_allow() -> None:
    names = [effect.name for effect in sled(1).effects]
    assert len(names) == len(set(names)) > 35
    for name in ("coulomb_friction_at_sled", "cogging_at_sled", "delay_of_place_m", "play_of_force_N"):
        assert name in names


def test_every_effect_does_something_and_neutral_is_nothing() -> None:
    whole = sled(1)
    plain = whole.with_terms(()).predicted({})
    assert np.array_equal(predicted(whole, {}), plain)
    sets = [strong(effect) for effect in whole.effects]
    spread = plain.std(axis=0)
    for effect, found in zip(whole.effects, whole.predicted_many(sets), strict=True):
        change = np.nanmax(np.abs(found - plain) / spread)
        assert change > 1e-3, effect.name


def test_parameters_begin_within_their_bounds_and_are_told_to_people() -> None:
    for effect in sled(1).effects:
        assert effect.explanation.endswith(".")
        assert effect.remedy.endswith(".")
        assert effect.experiment.endswith(".")
        for p in effect.parameters:
            assert not np.isfinite(p.neutral) or p.low <= p.neutral <= p.high, effect.name
            for start in effect.starts:
                assert p.low <= start.get(p.name, p.low) <= p.high, effect.name


def test_the_held_out_recording_takes_the_library_of_the_one_fitted() -> None:
    fit, other = sled(1), sled(2)
    assert other.like(fit).library is fit.library
    left = without(other, ["gain_of_force_N"])
    taken = left.like(without(fit, ["gain_of_force_N"]))  # type: ignore[attr-defined]
    assert taken.whole.library is fit.library


def test_what_needs_a_signal_is_not_offered_without_it() -> None:
    port = Port("tank", "m/s", "the tank", (Signal("level", "m", "level"),))
    span = PortSpan(port, (Span(0.0, 1.0, 1.0, 0.01),), 0.1, 1.0)
    assert friction(span, 0.1, 1.0) == []
    names = [term.effect.name for term in restoring(span, 0.1)]
    assert names == [
        "constant_at_tank",
        "leak_at_tank",
        "overflow_at_tank",
    ]


def test_a_hum_is_not_looked_for_where_an_input_has_a_line() -> None:
    whole = sled(1)
    t_s, force = whole.channels.t_s, whole.channels.inputs[:, 0]
    hum = 0.1 * np.sin(2.0 * np.pi * 3.7 * t_s)
    heard = replace(whole.channels, values=whole.channels.values + (0.2 * force + hum)[:, None])
    (tone,) = (each for each in replace(whole, channels=heard).effects if each.name == "tone_of_place_m")
    began_hz = [start["hz"] for start in tone.starts]
    assert began_hz[0] == pytest.approx(3.7, abs=0.05)
    for line_hz in (0.11, 0.23, 0.37, 0.61):
        assert min(abs(each - line_hz) for each in began_hz) > 0.05


def test_lost_samples_are_offered_where_neighbours_are_equal() -> None:
    moving = np.sin(np.arange(1000) * 0.1)
    assert lost(0, ("place_m",), moving) == []
    again = moving.copy()
    again[5::10] = again[4::10]
    (term,) = lost(0, ("place_m",), again)
    assert isinstance(term, SignalTerm)
    whole = sled(1, 1000, (term,))
    held = measuring(whole, {}, 1)
    held.channels.values[5::10, 0] = held.channels.values[4::10, 0]
    full = held.predicted({"dropped_samples_of_place_m.held": 1.0})
    assert np.allclose(full[5::10, 0], full[4::10, 0], rtol=1e-12, atol=1e-12)


def test_hidden_coulomb_friction_is_named_with_its_size() -> None:
    fit, other = hiding({"coulomb_friction_at_sled.value": 0.3}, 5)
    found = explain(fit, other, seed=1)
    (cause,) = found.verdict.causes
    assert cause.name == "coulomb_friction_at_sled"
    size = cause.parameters["value"]
    assert size.low is not None
    assert size.high is not None
    assert size.low <= 0.3 <= size.high


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "parameter", "value"),
    [
        ("quadratic_drag_at_sled", "value", 0.4),
        ("cubic_spring_at_sled", "value", 0.4),
        ("constant_at_sled", "value", 0.4),
        ("hysteresis_at_sled", "value", 0.6),
        ("delay_of_place_m", "value", 0.06),
        ("offset_of_speed_mps", "value", 0.1),
        ("dead_band_of_force_N", "half_width", 0.8),
        ("play_of_force_N", "width", 1.0),
        ("lag_of_speed_mps", "value", 0.1),
    ],
)
def test_a_hidden_effect_is_named_or_its_look_alike_with_it(name: str, parameter: str, value: float) -> None:
    fit, other = hiding({f"{name}.{parameter}": value}, 7)
    found = explain(fit, other, seed=1)
    told = {each for cause in found.verdict.causes for each in (cause.name, *cause.equivalents)}
    assert name in told


@pytest.mark.long
def test_nothing_is_named_where_nothing_is_hidden() -> None:
    fit, other = hiding({}, 9)
    assert explain(fit, other, seed=1).verdict.verdict in ("nothing", "cannot_tell")
