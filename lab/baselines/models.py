"""What others would do about a simulation that is wrong: three baselines, each fitted to one recording's residual.

All see what the finder sees: the base model, its inputs, one recording to fit. None knows an effect's name.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.optimize import Bounds, minimize

from discrepancy.problem import Problem
from discrepancy.search.refits import base_of
from messages.arrays import FloatArray
from messages.extras import needs

_MOST_INPUTS: Final = 8  # principal components of the inputs, and as many of their rates
_STEPS: Final = 8
_TOLD_APART: Final = 1e-6  # of a common parameter's power that channels' own gains cannot take: below, it stays
_LONGEST_DELAY_S: Final = 0.02
_THRESHOLDS: Final = (0.01, 0.03, 0.1, 0.3)  # of a standardised coefficient: what sparse regression drops
_GP_SAMPLES: Final = 300
_GP_STEPS: Final = 15  # of the search for its hyperparameters
_GP_SHOWN: Final = 4000  # samples predicted at a time
_VALIDATED: Final = 0.25  # of the recording to fit, its end, by which sparsity is chosen


@dataclass(frozen=True)
class Case:
    """A case: both recordings, the fitted base model's predictions of them (c, n) and what those leave (c, n)."""

    fit: Problem
    held: Problem
    values: dict[str, float]
    predicted_fit: FloatArray
    predicted_held: FloatArray

    @classmethod
    def of(cls, fit: Problem, held: Problem) -> "Case":
        """Return a case, its base model fitted as the finder fits it."""
        values = base_of(fit)[0].values
        before, after = fit.predicted(values), held.predicted(values)
        held.narrow(np.isfinite(after))
        return cls(fit, held, values, _finite(before), _finite(after))

    @property
    def residual_fit(self) -> FloatArray:
        """Return what the base model leaves of the recording to fit (c, n)."""
        return self.fit.difference(self.predicted_fit)

    @property
    def residual_held(self) -> FloatArray:
        """Return what it leaves of the other (c, n)."""
        return self.held.difference(self.predicted_held)


@dataclass(frozen=True)
class Told:
    """What a baseline makes of the held-out recording, (c, n), and what it says about the cause."""

    predicted: FloatArray
    says: str


@dataclass(frozen=True)
class Baseline:
    """A baseline by its name in the tables; `names` is what it can tell about a cause at all."""

    name: str
    names: str
    told: Callable[[Case], Told]


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, 0.0)


# --- plain parameter fitting -------------------------------------------------------------------------------------


def parameters_fitted(case: Case) -> Told:
    """Fit the base model's parameters with gain, bias and delay of every channel: (1 + g) p(t − τ) + b.

    Gauss and Newton's steps, each channel divided by what the base model leaves of it. Only the base model's parameters
    are common to the channels, so that each channel's three are eliminated first (Schur's complement).
    """
    problem = case.fit
    spread = np.array([r[v].std() if v.any() else 1.0 for r, v in zip(case.residual_fit, problem.valid, strict=True)])
    weight = np.where(problem.valid, 1.0, 0.0) / np.where(spread > 0.0, spread, 1.0)[:, None]
    values, own = dict(case.values), np.zeros((problem.c, 3))  # gain, bias, delay of each channel
    best = (np.inf, values, own)
    for _ in range(_STEPS):
        plain = problem.predicted(values)
        late = _late(_finite(plain), own[:, 2], problem.rate_hz)
        r = weight * problem.difference((1.0 + own[:, :1]) * late + own[:, 1:2])
        cost = float((r**2).sum())
        if cost > best[0] * (1.0 - 1e-6):
            break
        best = (cost, values, own)
        rate = np.gradient(late, 1.0 / problem.rate_hz, axis=1)
        L = weight[:, None] * np.stack((late, np.ones_like(late), -(1.0 + own[:, :1]) * rate), axis=1)  # (c, 3, n)
        columns = [_late(problem.column(values, plain, key)[0], own[:, 2], problem.rate_hz) for key in problem.base]
        G = weight * (1.0 + own[:, :1]) * np.array(columns).reshape(len(columns), problem.c, problem.n)
        common, each = _eliminated(L, G, r)
        values = problem.shifted(values, problem.base, common)
        own = own + each
        own[:, 2] = np.clip(own[:, 2], -_LONGEST_DELAY_S, _LONGEST_DELAY_S)
    _, values, own = best
    held = _late(_finite(case.held.predicted(values)), own[:, 2], case.held.rate_hz)
    gain, bias, delay = np.abs(own).argmax(axis=0)
    names = problem.channels.names
    says = (
        f"gain of {names[gain]} {own[gain, 0]:+.2%}, bias of {names[bias]} {own[bias, 1]:+.3g}, "
        f"delay of {names[delay]} {1e3 * own[delay, 2]:+.2f} ms"
    )
    return Told((1.0 + own[:, :1]) * held + own[:, 1:2], says)


def _eliminated(L: FloatArray, G: FloatArray, r: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the least-squares step of common (q,) and channels' own (c, 3) unknowns; L (c, 3, n), G (q, c, n)."""
    A = L @ L.transpose(0, 2, 1)
    A += 1e-9 * np.trace(A, axis1=1, axis2=2)[:, None, None] * np.eye(3) + np.finfo(float).tiny * np.eye(3)
    g = np.einsum("ckn,cn->ck", L, r)
    if not len(G):
        return np.zeros(0), np.linalg.solve(A, g[..., None])[..., 0]
    B = np.einsum("ckn,qcn->ckq", L, G, optimize=True)
    AB, Ag = np.linalg.solve(A, B), np.linalg.solve(A, g[..., None])[..., 0]
    whole = np.einsum("pcn,qcn->pq", G, G, optimize=True)
    S = whole - np.einsum("ckp,ckq->pq", B, AB, optimize=True)
    rhs = np.einsum("pcn,cn->p", G, r, optimize=True) - np.einsum("ckp,ck->p", B, Ag)
    size = np.sqrt(np.maximum(np.diag(whole), np.finfo(float).tiny))
    common = np.linalg.lstsq(S / np.outer(size, size), rhs / size, rcond=_TOLD_APART)[0] / size
    return common, Ag - AB @ common


def _late(values: FloatArray, delay_s: FloatArray, rate_hz: float) -> FloatArray:
    """Return `values` (c, n), each row late by its own delay, mirrored at the ends."""
    reach = min(round(2 * _LONGEST_DELAY_S * rate_hz) + 16, values.shape[1] - 1)
    padded = np.pad(values, ((0, 0), (reach, reach)), mode="reflect", reflect_type="odd")
    length = fft.next_fast_len(padded.shape[1], real=True)
    turn = np.exp(-2j * np.pi * np.outer(delay_s, fft.rfftfreq(length, 1.0 / rate_hz)))
    shifted: FloatArray = fft.irfft(fft.rfft(padded, length, axis=1) * turn, length, axis=1)
    return shifted[:, reach : reach + values.shape[1]]


# --- sparse regression on the residual ---------------------------------------------------------------------------


def sparsely_regressed(case: Case) -> Told:
    """Regress the residual on polynomials of the inputs and their rates by thresholded least squares (PySINDy's STLSQ).

    The threshold is the one that predicts the last quarter of the recording best; nothing is kept where none does.
    """
    needs("sparse regression", "pysindy")
    import pysindy

    fit_inputs, held_inputs, names = _inputs(case)
    library = pysindy.PolynomialLibrary(degree=2).fit(fit_inputs)
    theta, held_theta = np.asarray(library.transform(fit_inputs)), np.asarray(library.transform(held_inputs))
    size = np.where(theta.std(axis=0) > 0.0, theta.std(axis=0), 1.0)
    theta, held_theta = theta / size, held_theta / size
    there = case.fit.valid.all(axis=0) if case.fit.valid.all(axis=0).any() else np.ones(case.fit.n, bool)
    y = case.residual_fit.T
    scale = np.where(y[there].std(axis=0) > 0.0, y[there].std(axis=0), 1.0)
    y = y / scale
    rows = np.flatnonzero(there)
    train, test = np.split(rows, [round((1.0 - _VALIDATED) * len(rows))])

    def regressed(threshold: float, on: NDArray[np.intp]) -> FloatArray:
        optimizer = pysindy.STLSQ(threshold=threshold, alpha=1e-3 * len(on))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of thresholds that leave no term: then none is right
            coefficients: FloatArray = np.asarray(optimizer.fit(theta[on], y[on]).coef_)
        return coefficients  # (c, features)

    left = {t: float(((y[test] - theta[test] @ regressed(t, train).T) ** 2).sum()) for t in _THRESHOLDS}
    threshold = min(left, key=lambda t: left[t])
    if left[threshold] >= float((y[test] ** 2).sum()):
        return Told(case.predicted_held, "no term")
    coefficients = regressed(threshold, rows)
    row, column = np.unravel_index(int(np.abs(coefficients).argmax()), coefficients.shape)
    term = library.get_feature_names(names)[column]
    says = f"{np.count_nonzero(coefficients)} terms, first {term} in {case.fit.channels.names[row]}"
    return Told(case.predicted_held + (held_theta @ coefficients.T * scale).T, says)


def _inputs(case: Case) -> tuple[FloatArray, FloatArray, list[str]]:
    """Return inputs and their rates of both recordings, (n, k), standardised as the first one's, and their names."""
    first, second = (_filled(problem.channels.inputs) for problem in (case.fit, case.held))
    names = list(case.fit.channels.input_names)
    mean, spread = first.mean(axis=0), first.std(axis=0)
    moving = spread > 1e-12 * (1e-300 + np.abs(first).max(axis=0))
    first, second = ((each - mean)[:, moving] / spread[moving] for each in (first, second))
    names = [name for name, moves in zip(names, moving, strict=True) if moves]
    if len(names) > _MOST_INPUTS:
        vectors = np.linalg.eigh(first.T @ first)[1][:, ::-1][:, :_MOST_INPUTS]
        first, second = first @ vectors, second @ vectors
        names = [f"component_{k + 1}" for k in range(_MOST_INPUTS)]
    rates = [
        np.gradient(each, axis=0) * problem.rate_hz
        for each, problem in zip((first, second), (case.fit, case.held), strict=True)
    ]
    size = np.where(rates[0].std(axis=0) > 0.0, rates[0].std(axis=0), 1.0)
    names = [*names, *(f"rate_of_{name}" for name in names)]
    return np.hstack((first, rates[0] / size)), np.hstack((second, rates[1] / size)), names


def _filled(values: FloatArray) -> FloatArray:
    """Return `values` (n, k) with what is missing on the line between its neighbours, zero where a column has none."""
    out: FloatArray = values.copy()
    for column in out.T:
        there = np.isfinite(column)
        if not there.all():
            column[:] = np.interp(np.arange(len(column)), np.flatnonzero(there), column[there]) if there.any() else 0.0
    return out


# --- a Gaussian process ------------------------------------------------------------------------------------------


def process_regressed(case: Case) -> Told:
    """Take the residual for a Gaussian process over the inputs and their rates: linear plus smooth, and noise.

    One process for each channel, of 300 samples spread over the recording, its hyperparameters at the likelihood's
    maximum.
    """
    needs("a Gaussian process", "sklearn")
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, DotProduct, WhiteKernel

    fit_inputs, held_inputs, _ = _inputs(case)
    predicted = case.predicted_held.copy()
    residual = case.residual_fit
    told = 0
    for row in range(case.fit.c):
        there = np.flatnonzero(case.fit.valid[row])
        if len(there) < _GP_SAMPLES:
            continue
        at = there[np.linspace(0, len(there) - 1, _GP_SAMPLES).astype(int)]
        y = residual[row, at]
        spread = float(y.std())
        if spread == 0.0:
            continue
        kernel = (
            ConstantKernel(0.1, (1e-4, 1e2)) * DotProduct(1.0, (1e-3, 1e2))
            + ConstantKernel(0.1, (1e-4, 1e2)) * RBF(4.0, (0.5, 50.0))
            + WhiteKernel(0.5, (1e-6, 2.0))
        )
        process = GaussianProcessRegressor(kernel, optimizer=_searched)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of hyperparameters at their bounds, which is where they may be
            process.fit(fit_inputs[at], y / spread)
        for first in range(0, case.held.n, _GP_SHOWN):
            block = slice(first, first + _GP_SHOWN)
            predicted[row, block] += spread * np.asarray(process.predict(held_inputs[block]))
        told += 1
    return Told(predicted, f"{told} processes")


def _searched(
    cost: Callable[[FloatArray], tuple[float, FloatArray]], start: FloatArray, bounds: FloatArray
) -> tuple[FloatArray, float]:
    """Return hyperparameters of least `cost`, which tells its gradient too, and that cost, after a few steps."""
    found = minimize(cost, start, method="L-BFGS-B", jac=True, bounds=Bounds(*bounds.T), options={"maxiter": _GP_STEPS})
    return found.x, float(found.fun)


BASELINES: Final = (
    Baseline("parameter fitting", "gain, bias, delay of a channel", parameters_fitted),
    Baseline("sparse regression", "terms of the inputs", sparsely_regressed),
    Baseline("Gaussian process", "nothing", process_regressed),
)
