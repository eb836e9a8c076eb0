"""Terms made at ports: their units, words and formulas, and that a file names them well enough to be made again."""

from pathlib import Path

import numpy as np
import pytest

from discrepancy.construct.columns import Ports
from discrepancy.construct.construction import constructed
from discrepancy.construct.forms import FORMS, PIECES, curve, memory_rate
from discrepancy.construct.formula import told
from discrepancy.construct.terms import Constants, rebuilt, unit_over
from discrepancy.own_simulation import OwnSimulation
from discrepancy.ports.declared import Port, Signal
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.report.extended import load_extended, with_constructed
from discrepancy.values import Neutral, predicted
from discrepancy.verdict import Quantity
from lab.hidden.five.studied import CLEAN, studied
from lab.undeclared.five_systems import simulation
from tests.bench.spoilt import check_refused

ANGLE, RATE = Signal("angle", "rad", "position"), Signal("rate", "rad/s", "velocity")
JOINT = Port("joint", "N·m", "the joint", (ANGLE, RATE))
_TEXT = """\
system = "pendulum"

[effects.joint_wave_angle.sine]
value = -0.08
unit = "N·m"

[effects.joint_wave_angle.cosine]
value = 0.01
unit = "N·m"

[effects.joint_wave_angle.per_unit]
value = 8.0
unit = "1/rad"

[constructed.joint_wave_angle]
port = "joint"
form = "wave"
signals = ["angle"]
formula = "joint += ..."
"""


@pytest.mark.parametrize(
    ("unit", "by", "whole"),
    [
        ("N·m", [("rad/s", 2.0)], "N·m/(rad/s)²"),
        ("W", [("K", 4.0)], "W/K⁴"),
        ("N·m", [("rad", 0.0)], "N·m"),
        ("1", [("rad", 1.0)], "1/rad"),
        ("rad/s", [("1/s", 1.0)], "rad"),
    ],
)
def test_an_amount_has_the_unit_of_the_port_over_the_signal(unit: str, by: list[tuple[str, float]], whole: str) -> None:
    assert unit_over(unit, by) == whole


def test_a_term_is_told_as_a_formula_with_its_sizes() -> None:
    made = rebuilt(JOINT, FORMS["wave"], (ANGLE,), Constants())
    sizes = {
        "sine": Quantity(-0.08, -0.0801, -0.0799, "N·m"),
        "cosine": Quantity(-0.001, -0.0011, -0.0009, "N·m"),
        "per_unit": Quantity(8.0, 7.99, 8.01, "1/rad"),
    }
    found = told(made, sizes)
    assert found.formula == "joint += −0.08000·sin(8.0000·angle) − 0.00100·cos(8.0000·angle)"
    assert (found.port, found.form, found.signals, found.constants) == ("joint", "wave", ["angle"], {})


def test_what_acts_is_what_the_series_at_a_start_says() -> None:
    angle, rate = np.linspace(-1.0, 2.0, 50), np.linspace(3.0, -3.0, 50)
    for form in FORMS.values():
        if form.memory is None and not form.one_signed:
            made = rebuilt(JOINT, form, (ANGLE, RATE)[: form.arity], Constants(width=0.1))
            values = {p.name: np.array([1.0]) for p in made.effect.parameters}
            acts = made.term().formula([angle[None], rate[None]], [], values)[0]
            basis = form.basis((angle, rate)[: form.arity], np.ones(1), 0.1)
            assert np.allclose(acts, sum(basis)), form.name


def test_memories_stay_where_they_must() -> None:
    z = np.array([0.5])
    assert memory_rate("play", z, np.array([0.6]), np.array([0.2]), 0.1) == 0.0  # within the play nothing follows
    assert memory_rate("play", z, np.array([1.0]), np.array([0.2]), 0.1) > 0.0
    assert memory_rate("hysteresis", np.array([1.0]), np.array([2.0]), np.array([0.1]), 0.1) == 0.0  # saturated
    assert memory_rate("lag", z, z, np.array([0.1]), 0.1) == 0.0


def test_a_learned_curve_can_be_level_and_straight() -> None:
    form = curve(-1.0, 2.0)
    x = np.linspace(-1.0, 2.0, 40)
    basis = np.array(form.basis((x,), np.ones(1), 1.0))
    assert np.allclose(basis.sum(axis=0), 1.0)
    straight = np.arange(PIECES) @ basis
    assert np.allclose(np.diff(straight, 2), 0.0, atol=1e-12)


def test_columns_are_the_change_that_terms_make() -> None:
    fit = simulation("heater", studied("heater", CLEAN, 1, seconds=200.0), declared=True)
    at = Neutral(fit).completed({})
    ports = Ports(fit, at)
    names = ("body_square_temperature", "body_above_temperature")  # an input is held, and given on the line
    made = [each for each in ports.terms(at) if each.effect.name in names]
    assert len(made) == len(names)
    columns = iter(ports.columns(fit, at, made))
    whole = fit.with_terms([each.term() for each in made])
    before = predicted(whole, {})
    for each in made:
        for start in each.effect.starts or ({},):
            shape = {each.effect.qualified(name): value for name, value in start.items()}
            scale = 0.01 * each.effect.parameters[0].scale
            change = (predicted(whole, {**shape, each.keys[0]: scale}) - before) / 0.01
            column = next(columns)
            assert np.abs(change.T - column).max() <= 0.02 * np.abs(change).max() + 1e-9, each.effect.name


@pytest.fixture(scope="module")
def pendulum() -> PortedSimulation:
    """Return a pendulum with a short recording."""
    return simulation("pendulum", studied("pendulum", CLEAN, 1, seconds=2.0), declared=True)


def test_an_extended_model_brings_its_term_along(pendulum: PortedSimulation, tmp_path: Path) -> None:
    path = tmp_path / "extended.toml"
    path.write_text(_TEXT, encoding="utf-8")
    whole = with_constructed(path, pendulum)
    values = load_extended(path, whole)
    assert values == {
        "joint_wave_angle.sine": -0.08,
        "joint_wave_angle.cosine": 0.01,
        "joint_wave_angle.per_unit": 8.0,
    }
    assert not np.array_equal(predicted(whole, values), predicted(pendulum, {}))


@pytest.mark.parametrize(
    ("found", "written", "told"),
    [
        ('port = "joint"', 'port = "elbow"', r"constructed\.joint_wave_angle\.port elbow is unknown; .* is joint"),
        ('form = "wave"', 'form = "weave"', r"form weave is unknown; .* is wave"),
        ('signals = ["angle"]', 'signals = ["angles"]', r"signals angles is unknown; .* is angle"),
        ('signals = ["angle"]', 'signals = ["angle", "rate"]', r"signals: 2; expected 1"),
        ('signals = ["angle"]', 'signals = "angle"', r"signals is 'angle'; expected a list of names"),
        ('signals = ["angle"]', 'signals = ["rate"]', r"expected constructed\.joint_wave_rate"),
        ('formula = "', 'formulas = "', r"formulas is unknown"),
    ],
)
def test_a_spoilt_term_is_refused_in_one_line(
    pendulum: PortedSimulation, tmp_path: Path, found: str, written: str, told: str
) -> None:
    path = tmp_path / "extended.toml"
    check_refused(lambda path: with_constructed(path, pendulum), path, _TEXT, found, written, told)


def test_without_ports_nothing_is_constructed(pendulum: PortedSimulation) -> None:
    channels = pendulum.channels
    own = OwnSimulation("own", channels, lambda _values: np.zeros_like(channels.values), ())
    assert constructed([own], [], (), {}, 1) is None
