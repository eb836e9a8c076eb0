"""The plane fit: exact without noise, unmoved by outliers, honest about its own uncertainty."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from messages.arrays import FloatArray
from perception.ground.plane import PlaneFit, PlaneFitter

FB = 42.0


def rays_of_a_pitched_camera(step: int = 3) -> FloatArray:
    v, u = np.mgrid[0:120:step, 0:150:step]
    rays_C = np.stack(((u - 75) / 350, (v - 40) / 350, np.ones(u.shape)), axis=-1).reshape(-1, 3)
    s = np.sqrt(0.5)
    R_HC = np.array([[0, -s, s], [-1, 0, 0], [0, -s, -s]])
    rays_H: FloatArray = rays_C @ R_HC.T
    return rays_H


def disparity_of(rays: FloatArray, a: float, b: float, h: float) -> FloatArray:
    disparity: FloatArray = FB / h * (rays @ np.array([a, b, -1.0]))
    return disparity


def fit(rays: FloatArray, disparity: FloatArray, weight: FloatArray | None = None) -> PlaneFit:
    found = PlaneFitter(fB_px_m=FB).fit(rays, disparity, np.ones(len(rays)) if weight is None else weight)
    assert found is not None
    return found


@settings(max_examples=40, deadline=None)
@given(
    a=st.floats(-0.4, 0.4),
    b=st.floats(-0.4, 0.4),
    h=st.floats(0.5, 1.5),
)
def test_a_plane_without_noise_is_recovered_exactly(a: float, b: float, h: float) -> None:
    rays = rays_of_a_pitched_camera()
    found = fit(rays, disparity_of(rays, a, b, h))
    assert found.plane.gradient == pytest.approx((a, b), abs=1e-9)
    assert found.plane.height_m == pytest.approx(h, abs=1e-9)
    assert found.inlier_share == pytest.approx(1.0)


def test_gross_outliers_do_not_move_the_plane() -> None:
    rng = np.random.default_rng(5)
    rays = rays_of_a_pitched_camera()
    disparity = disparity_of(rays, 0.05, -0.02, 0.95) + rng.normal(0, 0.1, len(rays))
    wrong = rng.random(len(rays)) < 0.4
    disparity[wrong] += rng.uniform(3, 12, wrong.sum())
    found = fit(rays, disparity)
    assert found.plane.gradient == pytest.approx((0.05, -0.02), abs=0.01)
    assert found.plane.height_m == pytest.approx(0.95, abs=0.01)
    assert found.inlier_share == pytest.approx(0.6, abs=0.05)


def test_the_tread_wins_over_its_riser_and_over_the_plane_through_the_nosings() -> None:
    rng = np.random.default_rng(6)
    rays = rays_of_a_pitched_camera()
    x = rays[:, 0] / -rays[:, 2] * 0.95
    tread = x < np.median(x) + 0.05
    disparity = np.where(tread, disparity_of(rays, 0, 0, 0.95), disparity_of(rays, 0, 0, 0.78))
    weight = np.exp(-0.5 * ((x - np.median(x)) / 0.1) ** 2)
    found = fit(rays, disparity + rng.normal(0, 0.1, len(rays)), weight)
    assert found.plane.height_m == pytest.approx(0.95, abs=0.02)
    assert found.plane.gradient[0] == pytest.approx(0.0, abs=0.05)


def test_the_stated_covariance_covers_the_errors() -> None:
    rng = np.random.default_rng(7)
    rays = rays_of_a_pitched_camera()
    fitter = PlaneFitter(fB_px_m=FB)
    truth = np.array([0.03, 0.01, 0.95])
    squared = []
    for _ in range(120):
        found = fitter.fit(rays, disparity_of(rays, *truth) + rng.normal(0, 0.2, len(rays)), np.ones(len(rays)))
        assert found is not None
        error = np.array([*found.plane.gradient, found.plane.height_m]) - truth
        squared.append(error @ np.linalg.solve(found.covariance, error))
    # χ² with 3 degrees: mean 3; Tukey's weights cost 5 % efficiency
    assert np.mean(squared) == pytest.approx(3.0, rel=0.25)


def test_errors_that_neighbours_share_are_covered_without_knowing_over_how_many() -> None:
    rng = np.random.default_rng(8)
    rays, side = rays_of_a_pitched_camera(), 8
    fitter, truth = PlaneFitter(fB_px_m=FB), np.array([0.03, 0.01, 0.95])
    # each eight rays that follow one another in the grid are off alike
    block = np.arange(len(rays)) // side
    squared: list[float] = []
    unblocked: list[float] = []
    for _ in range(80):
        noise = np.repeat(rng.normal(0, 0.2, block[-1] + 1), side)[: len(rays)]
        disparity = disparity_of(rays, *truth) + noise
        for known, into in ((block, squared), (None, unblocked)):
            found = fitter.fit(rays, disparity, np.ones(len(rays)), block=known)
            assert found is not None
            error = np.array([*found.plane.gradient, found.plane.height_m]) - truth
            into.append(error @ np.linalg.solve(found.covariance, error))
    assert np.mean(squared) == pytest.approx(3.0, rel=0.35)
    assert np.mean(unblocked) > 10.0


def test_what_all_of_a_few_blocks_err_by_together_is_covered_though_their_misfit_does_not_show_it() -> None:
    rng = np.random.default_rng(9)
    rays = rays_of_a_pitched_camera()
    fitter, truth = PlaneFitter(fB_px_m=FB), np.array([0.03, 0.01, 0.95])
    block = 2 * (rays[:, 0] > np.median(rays[:, 0])).astype(np.int64) + (rays[:, 1] > np.median(rays[:, 1]))
    squared = []
    for _ in range(80):
        noise = rng.normal(0, 0.3, 4)[block] + rng.normal(0, 0.05, len(rays))
        disparity = disparity_of(rays, *truth) + noise
        found = fitter.fit(rays, disparity, np.ones(len(rays)), block=block, common_px=0.3)
        assert found is not None
        error = np.array([*found.plane.gradient, found.plane.height_m]) - truth
        squared.append(error @ np.linalg.solve(found.covariance, error))
    assert 1.5 < np.mean(squared) < 4.5


def test_a_wall_is_no_ground() -> None:
    rays = rays_of_a_pitched_camera()
    steep = disparity_of(rays, 2.5, 0.0, 2.6)
    assert PlaneFitter(fB_px_m=FB).fit(rays, steep, np.ones(len(rays))) is None


def test_degenerate_pixels_give_no_plane() -> None:
    rays = np.repeat(rays_of_a_pitched_camera()[:1], 200, axis=0)
    assert PlaneFitter(fB_px_m=FB).fit(rays, np.full(200, 30.0), np.ones(200)) is None
