"""The size of each error printed in the thesis's chapter 2: `python -m benchmarks.platform_printed_errors`."""

import numpy as np
from scipy.signal import fftconvolve

from impedance.body import geometry
from impedance.body.equations import body_wrench, plate_and_foot_wrench, tare
from impedance.body.kinematics import Kinematics
from impedance.body.rigid_body import Inertia, wrench_transform
from impedance.thesis.signals import LOW_PASS_LOST, derivative_taps, low_pass_taps, low_passed
from lab.thesis.printed import FOOT as PRINTED_FOOT
from lab.thesis.printed import RATES_HZ, body_of
from messages.arrays import FloatArray
from sim_rig.platform.rig import FOOT, MOTION_HZ, PLATE, THESIS_NOISE, UPPER_FRAME, Rig
from sim_rig.platform.run import RunSettings, SimulatedRun, simulate

SECONDS = 20.0
SEED = 1


def main() -> None:
    plate = simulate(RunSettings(duration_s=SECONDS), SEED)
    both = simulate(RunSettings(rig=Rig(foot=FOOT), duration_s=SECONDS), SEED)
    print(f"simulated: {SECONDS:g} s, 40 Hz, seed {SEED}, noise-free; rms of the error and of what it is part of")
    signs(plate)
    translation(plate)
    tare_moments()
    foot_terms(both)
    impossible_bodies()
    filters(plate)


def signs(run: SimulatedRun) -> None:
    """(1.b), (3): −d × (m p̈ + m g) in place of d × m (p̈ − g)."""
    true = body_wrench(PLATE, run.kinematics) - tare(PLATE)
    printed = true.copy()
    printed[:, 3:] += printed_moment(PLATE, run.kinematics) - body_wrench(PLATE, run.kinematics)[:, 3:]
    show("(1.b), (3) signs of d × (m p̈ − m g), plate, moment", printed[:, 3:] - true[:, 3:], true[:, 3:], "N m")


def printed_moment(body: Inertia, motion: Kinematics) -> FloatArray:
    """Return the left side of (1.b) as printed, (n, 3)."""
    d, J, w, alpha = body.cog_m, body.inertia_kgm2, motion.w, motion.alpha
    cog_mps2 = motion.a_O_P + np.cross(alpha, d) + np.cross(w, np.cross(w, d))
    moment: FloatArray = alpha @ J.T + np.cross(w, w @ J.T) - np.cross(d, body.mass_kg * (cog_mps2 + motion.g_P))
    return moment


def translation(run: SimulatedRun) -> None:
    """(1.a): exact with all vectors in I and R from P to I; as defined, R takes vectors from I to P and F_s is in P."""
    true = body_wrench(PLATE, run.kinematics)[:, :3] - tare(PLATE)[:3]
    R_IP = geometry.rotation_IP(*run.plate.euler_rad.T)
    cog_I = (body_wrench(PLATE, run.kinematics)[:, None, :3] @ np.swapaxes(R_IP, 1, 2))[:, 0]  # m (p̈ − g) in I
    weight_I = PLATE.mass_kg * geometry.GRAVITY_I_MPS2
    in_I = (true[:, None, :] @ np.swapaxes(R_IP, 1, 2))[:, 0]
    show("(1.a) all in I, R from P to I, force", cog_I + weight_I @ np.swapaxes(R_IP, 1, 2) - in_I, in_I, "N")
    show("(1.a) R from I to P and F_s in P as defined, force", cog_I + weight_I @ R_IP - true, true, "N")


def tare_moments() -> None:
    """(1.b): the tare zeroes moments too."""
    x, _, z = tare(PLATE)[3:]
    print(f"(1.b) tare's moments left out: about x {x:+.4f}, about z {z:+.4f} N m (noise {THESIS_NOISE.torque_nm:g})")


def foot_terms(run: SimulatedRun) -> None:
    """(2.b), (4): no lever from P to F, T_s twice; (2.a): m_b for m_f."""
    p_PF = np.array(run.settings.rig.foot_origin_m)
    true = plate_and_foot_wrench(PLATE, FOOT, run.kinematics, np.eye(3), p_PF)
    foot = body_wrench(FOOT, run.kinematics.of_mounted(np.eye(3), p_PF))
    with_lever = foot @ wrench_transform(np.eye(3), p_PF).T
    show("(2.b), (4) lever p_PF × f of the foot left out, moment", (foot - with_lever)[:, 3:], true[:, 3:], "N m")
    show("(4) T_s subtracted twice, moment", true[:, 3:], true[:, 3:], "N m")
    show(
        "(2.a) m_b taken for the plate's mass, force",
        foot[:, :3] * (1.0 - PLATE.mass_kg / FOOT.mass_kg),
        true[:, :3],
        "N",
    )


def impossible_bodies() -> None:
    """§2.2.1, §2.2.2 and Table 2: tensors that no body has."""
    moments = 1e-3 * np.array([81.1, 127.0, 137.2])
    printed = Inertia.about(FOOT.mass_kg, FOOT.cog_m, np.concatenate((moments, moments)))
    print(f"§2.2.1 foot, products equal to moments: principal moments {principal(printed)} g m²")
    frame = Inertia.about(9.0, UPPER_FRAME.cog_m, np.array([0.9, 0.9, 0.3, 0.2, 0.1, 0.1]))
    for how, body in (("entries of the tensor", frame), ("∫ yz dm", UPPER_FRAME)):
        print(f"§2.2.2 upper frame, products as {how}: moments {principal(body)} g m², excess {excess(body):.1f}")
    for rate_hz, column in zip(RATES_HZ, PRINTED_FOOT.experiment, strict=True):
        body = body_of(column)
        print(f"Table 2, {rate_hz} Hz: principal moments {principal(body)} g m², excess {excess(body):.1f}")


def principal(body: Inertia) -> str:
    return ", ".join(f"{1e3 * value:.1f}" for value in np.linalg.eigvalsh(body.inertia_kgm2))


def excess(body: Inertia) -> float:
    """Return the greatest principal moment minus the sum of the others, g m²: not above 0 for a body."""
    values = np.linalg.eigvalsh(body.inertia_kgm2)
    return float(1e3 * (values[2] - values[0] - values[1]))


def filters(run: SimulatedRun) -> None:
    """§2.2.3: a polynomial through all points, and a low pass before the products."""
    identity = np.zeros(13)
    identity[6] = 1.0
    unlike = np.abs(derivative_taps(MOTION_HZ, 0) - identity).max()
    print(f"Savitzky-Golay 12th order, 13 points: its taps differ from no filter by {unlike:.1e}")
    both = fftconvolve(low_pass_taps(MOTION_HZ), derivative_taps(MOTION_HZ, 2))
    noise_mps2 = THESIS_NOISE.position_m * float(np.linalg.norm(both))
    noise_n = PLATE.mass_kg * noise_mps2
    print(f"position noise of 0.1 mm, low-passed, differentiated twice: {noise_mps2:.3f} m/s², plate {noise_n:.3f} N")
    motion = run.kinematics
    filtered = Kinematics(*(low_passed(part, MOTION_HZ) for part in (motion.a_O_P, motion.w, motion.alpha, motion.g_P)))
    of_wrench = low_passed(body_wrench(PLATE, motion), MOTION_HZ)
    of_motion = body_wrench(PLATE, filtered)
    whole = body_wrench(PLATE, motion)[LOW_PASS_LOST:-LOW_PASS_LOST]
    for part, unit, name in ((slice(0, 3), "N", "force"), (slice(3, 6), "N m", "moment")):
        show(
            f"low pass before the products, {name}",
            (of_motion - of_wrench)[:, part],
            whole[:, part] - whole[:, part].mean(axis=0),
            unit,
        )


def show(what: str, error: FloatArray, whole: FloatArray, unit: str) -> None:
    error_rms, whole_rms = (np.sqrt((values**2).mean(axis=0)) for values in (error, whole))
    cells = ", ".join(f"{e:.3g} of {w:.3g}" for e, w in zip(error_rms, whole_rms, strict=True))
    print(f"{what}: x, y, z {cells} {unit}")


if __name__ == "__main__":
    main()
