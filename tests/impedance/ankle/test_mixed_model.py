"""The mixed linear model: exact where the priors say nothing, honest where they do."""

import numpy as np
import pytest

from impedance.ankle.mixed_model import Block, Prior, fit, whiten

ONE_SEGMENT = np.zeros(400, dtype=np.int64)


def test_free_blocks_alone_are_least_squares() -> None:
    rng = np.random.default_rng(1)
    X = rng.standard_normal((400, 5))
    y = X @ np.arange(1.0, 6.0) + 0.1 * rng.standard_normal(400)
    found = fit(y, [Block("a", X[:, :2], Prior.FREE), Block("b", X[:, 2:], Prior.FREE)], ONE_SEGMENT)
    expected, residual = np.linalg.lstsq(X, y)[:2]
    assert len(found.autoregression) == 0
    np.testing.assert_allclose(found.beta, expected, rtol=1e-9)
    np.testing.assert_allclose(found.of("b")[0], expected[2:], rtol=1e-9)
    assert found.sigma**2 == pytest.approx(residual[0] / 395.0, rel=1e-6)
    np.testing.assert_allclose(found.covariance, found.sigma**2 * np.linalg.inv(X.T @ X), rtol=1e-6)


def test_the_learnt_variance_and_the_noise_are_found() -> None:
    rng = np.random.default_rng(2)
    X = rng.standard_normal((400, 100))
    found = fit(
        X @ (3.0 * rng.standard_normal(100)) + 0.5 * rng.standard_normal(400),
        [Block("u", X, Prior.LEARNT)],
        ONE_SEGMENT,
    )
    assert np.sqrt(found.variances["u"]) == pytest.approx(3.0, rel=0.2)
    assert found.sigma == pytest.approx(0.5, rel=0.15)


def test_a_learnt_block_that_explains_nothing_vanishes() -> None:
    rng = np.random.default_rng(3)
    shared, idle = rng.standard_normal((400, 2)), rng.standard_normal((400, 30))
    y = shared @ np.array([1.0, -2.0]) + rng.standard_normal(400)
    found = fit(y, [Block("shared", shared, Prior.FREE), Block("idle", idle, Prior.LEARNT)], ONE_SEGMENT)
    assert np.sqrt(found.variances["idle"]) < 0.15
    assert found.freedom > 370.0


def test_the_colour_of_the_noise_is_found_and_segments_are_not_mixed() -> None:
    rng = np.random.default_rng(4)
    segment = np.repeat(np.arange(4), 500)
    noise = rng.standard_normal(2000)
    for k in range(1, 2000):
        if segment[k] == segment[k - 1]:
            noise[k] += 0.8 * noise[k - 1]
    x = np.ones((2000, 1))
    found = fit(2.0 * x[:, 0] + noise, [Block("level", x, Prior.FREE)], segment)
    assert found.autoregression[0] == pytest.approx(0.8, abs=0.05)
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(1.0 / 0.2 / np.sqrt(2000), rel=0.25)
    assert len(whiten(x, segment, found.autoregression)) == 2000 - 4 * len(found.autoregression)


def test_a_considered_block_moves_no_estimate_but_widens_its_interval() -> None:
    rng = np.random.default_rng(5)
    x = rng.standard_normal((400, 1))
    y = 2.0 * x[:, 0] + 0.01 * rng.standard_normal(400)
    blocks = [Block("x", x, Prior.FREE)]
    without = fit(y, blocks, ONE_SEGMENT)
    with_it = fit(y, [*blocks, Block("off", 0.3 * x, Prior.CONSIDERED)], ONE_SEGMENT)
    assert with_it.beta[0] == without.beta[0]
    assert np.sqrt(with_it.covariance[0, 0]) == pytest.approx(0.3, rel=1e-3)


def test_intervals_cover_what_they_promise() -> None:
    rng = np.random.default_rng(6)
    shape, wild = rng.standard_normal((120, 3)), rng.standard_normal((120, 12))
    inside = 0
    for _ in range(150):
        y = shape @ np.ones(3) + wild @ rng.standard_normal(12) + rng.standard_normal(120)
        found = fit(y, [Block("b", shape, Prior.FREE), Block("u", wild, Prior.UNIT)], np.zeros(120, dtype=np.int64))
        inside += int((np.abs(found.beta[:3] - 1.0) < 1.96 * np.sqrt(np.diag(found.covariance)[:3])).sum())
    assert 0.90 <= inside / 450 <= 0.985


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(ValueError, match="too few"):
        fit(np.ones(3), [Block("a", np.eye(3), Prior.FREE)], np.zeros(3, dtype=np.int64))
    with pytest.raises(ValueError, match="depend on each other"):
        fit(np.arange(9.0), [Block("a", np.ones((9, 2)), Prior.FREE)], np.zeros(9, dtype=np.int64))
