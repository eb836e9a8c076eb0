"""A parameter's three sizes: the step of differentiation, the unit that fits count in, and what matters to a person."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from discrepancy import explain
from discrepancy.problem import Problem
from discrepancy.simulation import Channels, Effect, Parameter, Values
from messages.arrays import FloatArray

BENT = Parameter("size", "1", 0.0, -10.0, 10.0, scale=0.1)
NOISE = 0.01


@dataclass(frozen=True)
class Bent:
    """Measured is u + 0.05 sin 3u + noise; predicted u + (s + s³) sin 3u, rounded as by a coarse integrator."""

    parameter: Parameter
    seed: int
    coarse: float = 0.0
    system: str = "bent"
    parameters: tuple[Parameter, ...] = ()

    @property
    def channels(self) -> Channels:
        random = np.random.default_rng(self.seed)
        t_s = np.arange(800) / 100.0
        u = np.sin(2.0 * t_s + self.seed)
        measured = u + 0.05 * np.sin(3.0 * u) + NOISE * random.standard_normal(len(t_s))
        return Channels(t_s, measured[:, None], ("y_m",), u[:, None], ("u_m",))

    @property
    def effects(self) -> tuple[Effect, ...]:
        return (Effect("ripple", (self.parameter,), "A ripple.", "Model it.", "Move slowly."),)

    def predicted(self, values: Values) -> FloatArray:
        s = values["ripple.size"]
        s = round(s / self.coarse) * self.coarse if self.coarse else s
        u = self.channels.inputs
        return np.asarray(u + (s + s**3) * np.sin(3.0 * u))


def found(parameter: Parameter, coarse: float = 0.0) -> tuple[str, ...]:
    told = explain(Bent(parameter, 1, coarse), Bent(parameter, 2, coarse), seed=1)
    return tuple(cause.name for cause in told.verdict.causes)


def test_what_does_not_matter_is_not_named_whatever_step_and_unit() -> None:
    assert found(replace(BENT, scale=0.01)) == ("ripple",)
    assert found(BENT) == ()  # its scale is what matters, where nothing else is said
    assert found(replace(BENT, matters=0.02)) == ("ripple",)
    assert found(replace(BENT, matters=0.0)) == ("ripple",)
    assert found(replace(BENT, scale=0.01, matters=0.08)) == ()


def test_a_step_below_the_simulations_own_numerics_tells_nothing_and_one_above_does() -> None:
    fine = replace(BENT, scale=0.001, matters=0.01)
    assert found(fine, coarse=0.01) == ()
    assert found(replace(fine, step=0.05), coarse=0.01) == ("ripple",)


@pytest.mark.parametrize("step", [1e-4, 0.1, 1.0])
def test_a_column_is_the_change_by_one_unit_whatever_the_step(step: float) -> None:
    problem = Problem(Bent(replace(BENT, step=step), 1))
    before = problem.predicted({})
    column, taken = problem.column({}, before, "ripple.size")
    assert taken == pytest.approx(step / 0.1)
    exact = 0.1 * np.sin(3.0 * problem.channels.inputs[:, 0])
    inside = problem.valid[0]
    assert np.allclose(column[0, inside], (1.0 + step**2) * exact[inside], rtol=1e-6)


def test_the_unit_changes_no_verdict() -> None:
    base = explain(Bent(replace(BENT, step=1e-3, matters=0.01), 1), Bent(BENT, 2), seed=1).verdict
    other = explain(Bent(replace(BENT, scale=7.0, step=1e-3, matters=0.01), 1), Bent(BENT, 2), seed=1).verdict
    for one, two in zip(base.causes, other.causes, strict=True):
        a, b = one.parameters["size"], two.parameters["size"]
        assert (a.value, a.low, a.high) == pytest.approx((b.value, b.low, b.high), rel=1e-3)
    assert base.causes


@pytest.mark.parametrize(
    ("change", "told"), [({"step": 0.0}, "step 0"), ({"step": 30.0}, "step 30"), ({"matters": -1.0}, "matters -1")]
)
def test_sizes_that_cannot_be_are_refused(change: dict[str, float], told: str) -> None:
    with pytest.raises(ValueError, match=f"size: {told}; expected"):
        replace(BENT, **change)  # type: ignore[arg-type]  # all of them are numbers
