"""The minimum of (5) and (6) approached as the thesis did: a trust-region method based on interior point.

SciPy's implementation of Byrd, Hribar and Nocedal, SIAM Journal on Optimization 9 (1999). It takes the cost for smooth,
but an absolute residual is not: without noise all its kinks meet at the minimum, and the descent stops where its steps
become small, short of the minimum along the direction that is least observable.
"""

import warnings
from typing import Final

import numpy as np
from scipy.optimize import Bounds, minimize

from impedance.body.rigid_body import Inertia
from impedance.thesis.estimator import WEIGHTS, LinearResidual
from messages.arrays import FloatArray

_MOST_STEPS: Final = 300
_LEAST_STEP: Final = 1e-10
_LEAST_GRADIENT: Final = 1e-6
_LARGEST: Final = (100.0, 1.0, 10.0)  # kg, m, kg m²


def descended(residual: LinearResidual, mass_kg: float | None, start: Inertia, *, moments_bounded: bool) -> Inertia:
    """Return the body where the descent from `start` stops; the mass is `mass_kg`, or unknown where that is None.

    The other unknowns are d and J about the centre of gravity.
    """
    columns = residual.columns.reshape(-1, 10)
    wrench = residual.wrench.reshape(-1)
    share = np.tile(WEIGHTS, len(residual.wrench)) / len(residual.wrench)
    known = np.array([] if mass_kg is None else [mass_kg])

    def body(unknowns: FloatArray) -> Inertia:
        ten = np.concatenate([known, unknowns])
        return Inertia.about(float(ten[0]), ten[1:4], ten[4:])

    def cost(unknowns: FloatArray) -> float:
        misfit = np.abs(columns @ residual.vector(body(unknowns)) - wrench)
        return float(share @ misfit)

    first = len(known)
    mass, length, moment = _LARGEST
    highest = np.array([mass, *[length] * 3, *[moment] * 6])[first:]
    lowest = np.array([0.0, *[-length] * 3, *[0.0] * 3, *[-moment] * 3])[first:]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "delta_grad", UserWarning)  # what kinks do to its quasi-Newton update
        found = minimize(
            cost,
            np.array([start.mass_kg, *start.cog_m, *start.about_cog()])[first:],
            method="trust-constr",
            bounds=Bounds(lowest, highest) if moments_bounded else None,
            options={"maxiter": _MOST_STEPS, "xtol": _LEAST_STEP, "gtol": _LEAST_GRADIENT},
        )
    return body(found.x)
