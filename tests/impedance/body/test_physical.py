"""Physically consistent estimates: a body that can exist, never farther than the truth, nothing moved in vain."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance.body.physical import boundary, consistent, is_consistent, pseudo_inertia
from impedance.body.rigid_body import Inertia
from messages.arrays import FloatArray

_SEEDS = st.integers(0, 2**31)


def _body(rng: np.random.Generator) -> FloatArray:
    """Return π (10,) of five point masses."""
    points, masses = rng.normal(size=(5, 3)) * rng.uniform(0.02, 0.3, 3), rng.uniform(0.1, 3.0, 5)
    cog = masses @ points / masses.sum()
    off = points - cog
    J = np.einsum("n,nij->ij", masses, (off**2).sum(axis=1)[:, None, None] * np.eye(3) - off[:, :, None] * off[:, None])
    return Inertia(float(masses.sum()), cog, J).vector


def _information(rng: np.random.Generator, vector: FloatArray) -> FloatArray:
    columns = rng.normal(size=(30, len(vector))) / (np.abs(vector) + 0.01) * rng.choice([1.0, 30.0])
    found: FloatArray = columns.T @ columns
    return found


@settings(max_examples=60, deadline=None)
@given(_SEEDS, st.sampled_from([1.0, 30.0, 300.0]), st.integers(1, 2))
def test_the_nearest_body_exists_and_is_nearer_than_the_true_one(seed: int, noise: float, bodies: int) -> None:
    rng = np.random.default_rng(seed)
    truth = np.concatenate([_body(rng) for _ in range(bodies)] + [rng.normal(size=2)])
    F = _information(rng, truth)
    plain = truth + noise * np.linalg.solve(np.linalg.cholesky(F).T, rng.normal(size=len(truth)))
    found = consistent(F, F @ plain, bodies)
    assert is_consistent(found[: 10 * bodies].reshape(bodies, 10))
    distance, of_truth = ((v - plain) @ F @ (v - plain) for v in (found, truth))
    assert distance <= of_truth + 1e-4
    if is_consistent(plain[: 10 * bodies].reshape(bodies, 10)):
        assert np.allclose(found, plain, rtol=1e-6, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(_SEEDS)
def test_at_the_boundary_no_way_inward_is_nearer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = _body(rng)
    F = _information(rng, truth)
    plain = truth + 300.0 * np.linalg.solve(np.linalg.cholesky(F).T, rng.normal(size=10))
    found = consistent(F, F @ plain, 1)
    cost = (found - plain) @ F @ (found - plain)
    for _ in range(10):
        inner = found + rng.uniform(1e-4, 0.5) * (_body(rng) - found)
        assert (inner - plain) @ F @ (inner - plain) >= cost - 1e-6 * (1.0 + cost)


@settings(max_examples=40, deadline=None)
@given(_SEEDS)
def test_a_flat_body_says_that_it_is_flat(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vector = _body(rng)
    assert boundary(vector) is None
    P = pseudo_inertia(vector)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    pressed = np.eye(4)
    pressed[:3, :3] -= (1.0 - 1e-6) * np.outer(normal, normal)
    flat = pressed @ P @ pressed.T
    S = flat[:3, :3]
    J = np.trace(S) * np.eye(3) - S
    found = boundary(np.array([flat[3, 3], *flat[:3, 3], J[0, 0], J[1, 1], J[2, 2], J[1, 2], J[0, 2], J[0, 1]]))
    assert found is not None
    assert abs(found.normal @ normal) > 0.999
    assert "triangle inequality" in found.words
