"""A real seven-joint arm, identified on a part of its motion, predicted on the rest.

KUKA LWR4+ with joint torque sensors (kjyv/FloBaRoID, run 1, 25 s at 200 Hz). Only run 1 is at hand, so what is held out
is the second half of the run, the first half, or every other fifth; the published figures hold out a second run of the
same excitation. Per joint j, with Y_i the regressor of link i about its own origin,

    τ_j = z_jᵀ Σ_{i ≥ j} X_ji Y_i π_i + c_j sgn(q̇_j) + v_j q̇_j + o_j                                             (1)

The links are physically consistent; where the motion tells nothing, they stay at the values of the arm's description,
each known to its own size only.
"""

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from impedance.body.geometry import PLATFORM_GRAVITY_MPS2
from impedance.body.physical import consistent
from impedance.body.rigid_body import Inertia, regressor
from messages.arrays import BoolArray, FloatArray

JOINTS = 7
LINK_PARAMETERS = 10
_FRICTION = 3
_CREEP_RADPS = 0.01
_GRAVITY = np.array([0.0, 0.0, -PLATFORM_GRAVITY_MPS2])
"""As everywhere where bodies are identified."""
_REWEIGHTINGS = 3
_LINK_SIZE = np.array([1.0, *(0.1,) * 3, *(0.01,) * 6])
"""Deviations of mass, first moment (of 0.1 m) and tensor (of 0.1 m squared), per kilogram of the description."""
_FRICTION_SIZE = np.array([1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Joint:
    """R and p (3,) of the joint in its parent link, its axis (3,), and the link that it carries."""

    R: FloatArray
    p_m: FloatArray
    axis: FloatArray
    link: Inertia
    friction: FloatArray
    """Coulomb, viscous, offset of the description (3,)."""


@dataclass(frozen=True)
class Run:
    """q, q̇, q̈ and τ, each (n, 7)."""

    q: FloatArray
    rate: FloatArray
    acceleration: FloatArray
    torque: FloatArray


@dataclass(frozen=True)
class Prediction:
    """How far the predicted torque is from the measured one.

    `relative` is |τ − τ̂| / |τ| and `nrms` the root mean square of the difference over the torques' range, both over
    all joints; `rms_nm` (7,) by joint.
    """

    relative: float
    nrms: float
    rms_nm: FloatArray


def read_arm(path: Path) -> list[Joint]:
    """Return the seven joints of the description, base first."""
    root = ElementTree.parse(path).getroot()
    links = {link.get("name"): link for link in root.iter("link")}
    joints = []
    for number in range(JOINTS):
        joint = next(j for j in root.iter("joint") if j.get("name") == f"lwr_{number}_joint" and j.get("type"))
        child = _found(joint, "child").get("link")
        inertial = _found(links[child], "inertial")
        entries = _found(inertial, "inertia")
        six = np.array([float(entries.get(f"i{name}", "nan")) for name in ("xx", "yy", "zz", "yz", "xz", "xy")])
        origin, dynamics = _found(joint, "origin"), _found(joint, "dynamics")
        joints.append(
            Joint(
                R=Rotation.from_euler("xyz", _vector(origin, "rpy")).as_matrix(),
                p_m=_vector(origin, "xyz"),
                axis=_vector(_found(joint, "axis"), "xyz"),
                link=Inertia.about(
                    float(_found(inertial, "mass").get("value", "nan")), _vector(_found(inertial, "origin"), "xyz"), six
                ),
                friction=np.array([float(dynamics.get(name, "0")) for name in ("friction", "damping")] + [0.0]),
            )
        )
    return joints


def read_run(path: Path) -> Run:
    """Return the recorded run."""
    with np.load(path) as data:
        names = ("positions", "velocities", "accelerations", "torques")
        q, rate, acceleration, torque = (data[name].astype(np.float64) for name in names)
    return Run(q, rate, acceleration, torque)


def columns(joints: list[Joint], run: Run) -> FloatArray:
    """Return the columns (n, 7, 91) of (1): seven links of ten, then Coulomb, viscous and offset of each joint."""
    count = len(run.q)
    w, alpha, a = np.zeros((3, count, 3))
    g = np.broadcast_to(_GRAVITY, (count, 3))
    turns: list[FloatArray] = []
    wrenches: list[FloatArray] = []
    for number, joint in enumerate(joints):
        turn = joint.R @ Rotation.from_rotvec(run.q[:, number, None] * joint.axis).as_matrix()
        a = a + np.cross(alpha, joint.p_m) + np.cross(w, np.cross(w, joint.p_m))
        w, alpha, a, g = (np.einsum("nij,ni->nj", turn, each) for each in (w, alpha, a, g))
        spin = run.rate[:, number, None] * joint.axis
        alpha = alpha + np.cross(w, spin) + run.acceleration[:, number, None] * joint.axis
        w = w + spin
        turns.append(turn)
        wrenches.append(regressor(a, g, w, alpha))
    Y = np.zeros((count, JOINTS, JOINTS * (LINK_PARAMETERS + _FRICTION)))
    for link in range(JOINTS):
        wrench = wrenches[link]
        for number in range(link, -1, -1):
            Y[:, number, LINK_PARAMETERS * link : LINK_PARAMETERS * (link + 1)] = np.einsum(
                "i,nik->nk", joints[number].axis, wrench[:, 3:]
            )
            force = turns[number] @ wrench[:, :3]
            moment = turns[number] @ wrench[:, 3:] + np.cross(joints[number].p_m, force, axisb=1, axisc=1)
            wrench = np.concatenate((force, moment), axis=1)
    for number in range(JOINTS):
        first = JOINTS * LINK_PARAMETERS + _FRICTION * number
        rate = run.rate[:, number]
        Y[:, number, first : first + 3] = np.column_stack((np.tanh(rate / _CREEP_RADPS), rate, np.ones(count)))
    return Y


def told(joints: list[Joint]) -> FloatArray:
    """Return the parameters (91,) of the arm's description."""
    return np.concatenate([*(joint.link.vector for joint in joints), *(joint.friction for joint in joints)])


def identified(Y: FloatArray, torque: FloatArray, prior: FloatArray) -> FloatArray:
    """Return physically consistent parameters (91,) of samples Y (n, 7, 91), torque (n, 7)."""
    mass_kg = prior[: LINK_PARAMETERS * JOINTS : LINK_PARAMETERS, None]
    size = np.concatenate(((mass_kg * _LINK_SIZE).reshape(-1), np.tile(_FRICTION_SIZE, JOINTS)))
    share = 1.0 / size**2
    noise = np.ones(JOINTS)
    for _ in range(_REWEIGHTINGS):
        weighted = Y / noise[:, None]
        flat = weighted.reshape(-1, len(prior))
        information = flat.T @ flat + np.diag(share)
        rhs = flat.T @ (torque / noise).reshape(-1) + share * prior
        vector = consistent(information, rhs, JOINTS)
        noise = _deviation(torque - Y @ vector)
    return vector


def _deviation(left: FloatArray) -> FloatArray:
    """Return (7,) the deviation that white noise of the same power at frequency zero has: what is left is friction and
    flexibility, not white, so that far fewer samples are independent than recorded.
    """
    count = len(left)
    spectrum = np.abs(np.fft.rfft(left - left.mean(axis=0), 2 * count, axis=0)) ** 2
    correlation = np.fft.irfft(spectrum, axis=0)[:count]
    correlation /= correlation[0]
    positive = np.minimum.accumulate(correlation > 0.0, axis=0)
    independent = 2.0 * (correlation * positive).sum(axis=0) - 1.0
    deviation: FloatArray = np.sqrt((left**2).mean(axis=0) * independent)
    return deviation


def judged(Y: FloatArray, torque: FloatArray, vector: FloatArray) -> Prediction:
    """Return how well `vector` predicts."""
    left = torque - Y @ vector
    rms = np.sqrt((left**2).mean(axis=0))
    return Prediction(
        relative=float(np.linalg.norm(left) / np.linalg.norm(torque)),
        nrms=float(np.sqrt((left**2).mean()) / np.ptp(torque)),
        rms_nm=rms,
    )


def splits(count: int) -> dict[str, BoolArray]:
    """Return by name which samples (n,) are fitted; the others are held out."""
    place = np.arange(count) / count
    return {
        "first half": place < 0.5,
        "second half": place >= 0.5,
        "four fifths, interleaved": (place * 10).astype(int) % 5 != 2,
    }


def _found(element: ElementTree.Element, name: str) -> ElementTree.Element:
    found = element.find(name)
    if found is None:
        raise ValueError(f"<{element.tag} name={element.get('name')}> holds no <{name}>")
    return found


def _vector(element: ElementTree.Element, name: str) -> FloatArray:
    return np.array([float(each) for each in element.get(name, "0 0 0").split()])
