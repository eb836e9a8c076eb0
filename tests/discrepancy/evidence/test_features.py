"""The bank of functions against a slow reference sample by sample; standard rows; many inputs become few."""

import numpy as np
import pytest

from discrepancy.evidence.features import features
from messages.arrays import FloatArray
from tests.bench.linear_bench import autoregressive

_N = 240


def standard(row: list[float]) -> list[float]:
    """Return a row with mean 0 and power 1."""
    mean = sum(row) / len(row)
    power = sum((each - mean) ** 2 for each in row) / len(row)
    return [(each - mean) / power**0.5 for each in row]


def rate(row: list[float]) -> list[float]:
    """Return central differences, one-sided at both ends."""
    inner = [(row[t + 1] - row[t - 1]) / 2.0 for t in range(1, len(row) - 1)]
    return [row[1] - row[0], *inner, row[-1] - row[-2]]


def shifted(row: list[float], samples: int) -> list[float]:
    """Return a row later by some samples; what leaves at one end comes in at the other."""
    return [row[(t - samples) % len(row)] for t in range(len(row))]


def sign(value: float) -> float:
    return float((value > 0.0) - (value < 0.0))


def correlation_time(row: list[float]) -> int:
    """Return the first lag at which the autocorrelation is below 0.7."""
    n = len(row)
    return next(lag for lag in range(n) if sum(row[t] * row[t - lag] for t in range(lag, n)) / n < 0.7)


def reference(inputs: FloatArray, predicted: FloatArray) -> dict[str, list[list[float]]]:
    """Return the functions of two inputs and of the predicted outputs, written out."""
    n = inputs.shape[1]
    u, y = ([standard(row) for row in rows.tolist()] for rows in (inputs, predicted))
    tau = [2.0 * t / (n - 1) - 1.0 for t in range(n)]
    lag = int(np.median([correlation_time(row) for row in u]))
    rates = [rate(row) for row in u]
    slopes = [rate(row) for row in y]
    high = [float(np.quantile([abs(each) for each in row], 0.9)) for row in y]
    groups = {
        "time": [tau, [each**2 for each in tau], *([a * b for a, b in zip(row, tau, strict=True)] for row in y)],
        "lags": [
            *u,
            *rates,
            *(rate(row) for row in rates),
            *(shifted(row, k * lag) for k in (-4, -1, 1, 4) for row in u),
        ],
        "products": [[a * b for a, b in zip(u[i], u[j], strict=True)] for i in range(len(u)) for j in range(i, len(u))],
        "distortions": [
            *([sign(each) for each in row] for row in rates),
            *([abs(each) for each in row] for row in u),
            *([each**3 for each in row] for row in u),
            *([sign(each) for each in row] for row in u),
        ],
        "outputs": [
            *y,
            *([each**2 for each in row] for row in y),
            *([each**3 for each in row] for row in y),
            *([sign(each) * max(abs(each) - most, 0.0) for each in row] for row, most in zip(y, high, strict=True)),
            *slopes,
            *([sign(each) for each in row] for row in slopes),
        ],
    }
    return {name: [standard(row) for row in rows] for name, rows in groups.items()}


def records(k: int, c: int = 1, colour: float = 0.9) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(7303)
    scale = np.arange(1.0, k + 1.0)[:, None]
    return 5.0 + scale * autoregressive(rng, (k, _N), (colour,)), 3.0 * autoregressive(rng, (c, _N), (0.8,)) - 7.0


@pytest.mark.parametrize("colour", [0.9, 0.97])
def test_functions_are_those_of_the_reference(colour: float) -> None:
    inputs, predicted = records(2, 2, colour)
    found, expected = features(inputs, predicted), reference(inputs, predicted)
    assert list(found) == list(expected)
    for name, rows in expected.items():
        assert found[name].shape == (len(rows), _N)
        assert np.allclose(found[name], rows, atol=1e-7), name


@pytest.mark.parametrize("k", [1, 3, 20])
def test_every_function_has_mean_0_and_power_1(k: int) -> None:
    for name, rows in features(*records(k)).items():
        assert np.allclose(rows.mean(axis=1), 0.0, atol=1e-9), name
        assert np.allclose((rows**2).mean(axis=1), 1.0), name


def test_units_and_offsets_of_inputs_and_outputs_do_not_matter() -> None:
    inputs, predicted = records(2)
    scaled = features(1e-6 * inputs + 4.0, 1e5 * predicted)
    for name, rows in features(inputs, predicted).items():
        assert np.allclose(scaled[name], rows, atol=1e-6), name


def test_a_gap_is_bridged_by_a_straight_line() -> None:
    inputs, predicted = records(2)
    with_gap, bridged = inputs.copy(), inputs.copy()
    with_gap[0, 50:60] = np.nan
    bridged[0, 49:61] = np.linspace(inputs[0, 49], inputs[0, 60], 12)
    expected = features(bridged, predicted)
    for name, rows in features(with_gap, predicted).items():
        assert np.allclose(rows, expected[name]), name


def test_what_does_not_vary_or_is_not_there_tells_nothing() -> None:
    inputs, predicted = records(2)
    still = np.concatenate((inputs, np.full((1, _N), 3.0), np.full((1, _N), np.nan)))
    expected = features(inputs, predicted)
    for name, rows in features(still, predicted).items():
        assert np.array_equal(rows, expected[name]), name
    assert list(features(still[2:], predicted)) == ["time", "outputs"]
    assert list(features(inputs, still[2:])) == ["time", "lags", "products", "distortions"]


def test_of_many_inputs_the_twelve_strongest_directions_are_kept_and_eight_are_multiplied() -> None:
    rng = np.random.default_rng(7303)
    sources = autoregressive(rng, (12, _N), (0.5,))
    inputs = np.concatenate((sources, rng.normal(size=(8, 12)) @ sources))
    groups = features(inputs, records(1)[1])
    assert len(groups["lags"]) == 12 * 7
    assert len(groups["products"]) == 8 * 9 // 2
    kept = groups["lags"][:12]
    assert np.allclose(kept @ kept.T / _N, np.eye(12), atol=1e-6)
    for row in inputs:  # twelve directions tell all twenty inputs
        row = row - row.mean()
        assert np.allclose((row @ kept.T / _N) @ kept, row, atol=1e-6)
