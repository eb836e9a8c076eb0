"""What a laboratory does not know: used where the markers tell it, in the intervals where not, refused beyond that."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from impedance.body.geometry import rotation_IP
from impedance.identification import checks
from impedance.identification.considered import corrected, errors_of, wrench_matrices
from impedance.identification.identification import Identification, identify
from impedance.identification.noise_level import noise_level
from impedance.identification.observability import NAMES, about_cog
from impedance.recording.recording import PlatformRecording, Poses, UncertaintySettings
from impedance.recording.synchronous import synchronous
from messages.arrays import FloatArray
from messages.errors import UserError
from tests.bench.platform_motion import FOOT, L_M, PLATE, lines, noisy, recording, undeclared

SECONDS = 8.0
BESIDE_M = np.array([3e-3, 0.0, 2e-3])


def uncertain(known: PlatformRecording, **stated: float) -> PlatformRecording:
    """Return `known` with the usual uncertainties, or those `stated`."""
    settings = msgspec.structs.replace(known.settings, uncertainty=UncertaintySettings(**stated))
    return replace(known, settings=settings)


def instrumented(known: PlatformRecording, matrix: FloatArray, delay_s: float = 0.0) -> PlatformRecording:
    """Return what a force plate with this gain, crosstalk and delay reads."""
    f_hz = np.fft.rfftfreq(len(known.force_t_s), 1.0 / known.settings.rates.force_hz)
    late = np.exp(-2j * np.pi * f_hz * delay_s)[:, None] * np.fft.rfft(known.wrench, axis=0)
    return replace(known, wrench=np.fft.irfft(late, len(known.wrench), axis=0) @ matrix.T)


def beside(known: PlatformRecording) -> PlatformRecording:
    """Return what is seen where the plate's centre, its origin, lies beside the joint."""
    moved = known.plate.p_m + rotation_IP(*known.plate.euler_rad.T) @ BESIDE_M
    wrench = known.wrench.copy()
    wrench[:, 3:] -= np.cross(BESIDE_M, wrench[:, :3])
    return replace(known, plate=Poses(moved, known.plate.euler_rad), wrench=wrench)


def holds(found: Identification, truth: FloatArray) -> dict[str, bool]:
    """Return which intervals hold."""
    inside = (found.interval[:, 0] <= truth) & (truth <= found.interval[:, 1])
    return dict(zip(NAMES, inside.tolist(), strict=True))


@pytest.fixture(scope="module")
def plate() -> PlatformRecording:
    return recording(lines(1), SECONDS)


@pytest.fixture(scope="module")
def foot() -> PlatformRecording:
    return recording(lines(2), SECONDS, FOOT)


def test_a_joint_beside_the_plates_centre_is_seen_and_used(plate: PlatformRecording) -> None:
    found = identify(uncertain(noisy(beside(plate), 3)))
    truth = about_cog(PLATE.vector)
    truth[1:4] -= BESIDE_M
    assert found.constrained
    assert found.test.seen_m == pytest.approx(BESIDE_M + np.array([0.0, L_M, 0.0]), abs=1e-3)
    assert any(note.startswith("joint_offset") and note.endswith(": used") for note in found.notes)
    assert holds(found, truth)["x0"]
    assert holds(found, truth)["z0"]
    assert found.estimate[[1, 3]] == pytest.approx(truth[[1, 3]], abs=1.2e-3)


@pytest.mark.long
def test_where_the_joint_is_stated_as_exact_the_markers_refute_it(plate: PlatformRecording) -> None:
    found = identify(uncertain(noisy(beside(plate), 3), joint_m=0.0))
    assert not found.constrained
    assert any("markers refute the joint" in note for note in found.notes)


@pytest.mark.long
def test_no_interval_of_the_mass_is_below_what_the_gain_allows(
    plate: PlatformRecording, foot: PlatformRecording
) -> None:
    known = identify(uncertain(instrumented(noisy(plate, 3), 1.005 * np.eye(6)))).known
    found = identify(uncertain(instrumented(noisy(foot, 4), 1.005 * np.eye(6))), known)
    low, high = found.interval[0]
    assert low <= FOOT.mass_kg <= high
    assert high - low > 2.0 * 1.96 * 0.005 * FOOT.mass_kg
    assert found.noise_deviation[0] < 1e-3
    exact = identify(uncertain(noisy(foot, 4), gain_share=0.0, crosstalk_share=0.0, axes_rad=0.0, reference_m=0.0))
    assert exact.observability.deviation[0] < 0.1 * found.observability.deviation[0]


def test_gain_crosstalk_axes_and_delay_together_stay_inside_the_intervals(foot: PlatformRecording) -> None:
    rng = np.random.default_rng(7)
    shares = 0.005 * rng.choice((-1.0, 1.0), 36)
    turned = np.kron(np.eye(2), Rotation.from_rotvec([0.003, -0.003, 0.003]).as_matrix())
    matrix = (np.eye(6) + np.einsum("k,kij->ij", shares, wrench_matrices(0.25)[1:37])) @ turned
    found = identify(uncertain(instrumented(noisy(foot, 5), matrix, 3e-4)))
    assert sum(holds(found, about_cog(FOOT.vector)).values()) >= 9
    assert found.chi2_left == pytest.approx(1.0, abs=0.05)
    assert found.fit.chi2_ratio == pytest.approx(1.0, abs=0.05)
    assert any(note.startswith("force_delay") and "+0.300" in note for note in found.notes)


def known_mass(seen: PlatformRecording, mass_kg: float) -> PlatformRecording:
    """Return the recording of a foot that another scale weighed."""
    foot = msgspec.structs.replace(seen.settings.foot, mass_kg=mass_kg)
    return replace(seen, settings=msgspec.structs.replace(seen.settings, foot=foot))


def test_a_gain_that_all_channels_share_is_told_by_a_known_weight(
    plate: PlatformRecording, foot: PlatformRecording
) -> None:
    known = identify(uncertain(instrumented(noisy(plate, 6), 1.05 * np.eye(6)))).known
    faulty = uncertain(instrumented(noisy(foot, 5), 1.05 * np.eye(6)))
    silent = identify(faulty, known)
    assert silent.estimate[0] == pytest.approx(1.05 * FOOT.mass_kg, rel=5e-3)
    assert any("shows in no motion" in note for note in silent.notes)
    with pytest.raises(UserError, match=r"reads the foot of 22.7 kg as 23.8\d* kg, a gain of \+4.9.* in all channels"):
        identify(known_mass(faulty, FOOT.mass_kg), known)


def test_a_known_weight_takes_a_small_gain_out(foot: PlatformRecording) -> None:
    slight = uncertain(instrumented(noisy(foot, 5), 1.004 * np.eye(6)))
    found = identify(known_mass(slight, FOOT.mass_kg))
    assert all(holds(found, about_cog(FOOT.vector)).values())
    assert found.estimate[0] == pytest.approx(FOOT.mass_kg, abs=0.02)
    assert found.observability.deviation[0] == pytest.approx(0.005, rel=0.05)
    assert any("is read -0.2" in note and "taken out" in note for note in found.notes)


def test_a_plate_that_another_scale_weighed_tells_the_gain(plate: PlatformRecording) -> None:
    faulty = instrumented(noisy(plate, 6), 1.05 * np.eye(6))
    with pytest.raises(UserError, match=r"reads the plate of 4\.64\d* kg as .* in all channels alike"):
        identify(uncertain(faulty, mass_share=0.001))


@pytest.mark.parametrize(
    ("matrix", "delay_s", "said"),
    [
        (np.eye(6), 5e-3, r"force_delay of \+5\."),
        (np.diag([1.1, 1.0, 1.0, 1.0, 1.0, 1.0]), 0.0, r"a gain of .* \(fx\)"),
    ],
)
def test_what_no_laboratory_errs_by_is_refused_and_named(
    plate: PlatformRecording, matrix: FloatArray, delay_s: float, said: str
) -> None:
    with pytest.raises(UserError, match=said) as refused:
        identify(uncertain(instrumented(noisy(plate, 6), matrix, delay_s)))
    assert "uncertainty." in str(refused.value)
    assert "\n" not in str(refused.value)


def test_instruments_that_are_exact_are_not_refused(plate: PlatformRecording) -> None:
    found = identify(noisy(plate, 8))
    assert not found.checked.refuted
    assert found.observability.deviation == pytest.approx(found.noise_deviation)


@pytest.mark.long
def test_the_plates_run_tells_the_foots_of_the_instruments(plate: PlatformRecording, foot: PlatformRecording) -> None:
    matrix = np.eye(6)
    matrix[3, 2] = 1e-3
    alone = identify(uncertain(instrumented(noisy(foot, 9), matrix)))
    known = identify(uncertain(instrumented(noisy(plate, 10), matrix))).known
    both = identify(uncertain(instrumented(noisy(foot, 9), matrix)), known)
    assert sum(holds(both, about_cog(FOOT.vector)).values()) >= 9
    assert both.observability.deviation[4] < alone.observability.deviation[4]


def test_the_report_says_what_is_known_of_the_instruments(plate: PlatformRecording) -> None:
    found = identify(uncertain(noisy(plate, 11)))
    rows = checks.rows(found.checked, found.test, found.stated.joint_m)
    assert [row[0].split()[0] for row in rows] == ["joint"] * 3 + [
        "force_delay",
        "gain",
        "crosstalk",
        "axes",
        "reference",
    ]
    assert all(row[-1] == "agrees" for row in rows)
    told = checks.facts(found.checked, found.test)["errors"]
    assert isinstance(told, list)
    assert len(told) == 44


@pytest.mark.long
def test_noise_of_each_channel_follows_from_the_misfit(plate: PlatformRecording) -> None:
    seen = undeclared(noisy(plate, 12))
    t_s = seen.t_s[:, None]
    ringing = 8.0 * np.sin(2.0 * np.pi * np.array([140.0, 150.0, 160.0]) * t_s)
    rng = np.random.default_rng(12)
    wrench = seen.wrench + np.hstack((ringing, 0.0 * ringing))
    wrench[:, 1] += 0.4 * rng.standard_normal(len(wrench))
    found = identify(replace(seen, wrench=wrench))
    assert noise_level(synchronous(replace(seen, wrench=wrench))).force_n > 1.0
    assert found.noise.wrench_std == pytest.approx([0.1, 0.41, 0.1, 0.05, 0.05, 0.05], rel=0.2)
    assert found.noise.angle_rad == pytest.approx(1e-5, rel=0.12)
    assert any("estimated from the misfit" in note for note in found.notes)
    known = identify(noisy(plate, 12))
    assert (found.noise_deviation[1:] < 5.0 * known.noise_deviation[1:]).all()


def test_what_is_taken_out_of_a_wrench_is_what_the_errors_put_in() -> None:
    rng = np.random.default_rng(1)
    t_s = np.arange(1400) / 350.0
    wrench = np.sin(2.0 * np.pi * np.array([3.0, 5.0, 7.0, 9.0, 11.0, 13.0]) * t_s[:, None])
    value = np.append(0.01 * rng.standard_normal(43), (2e-3, 0.0))
    matrix = np.eye(6) + np.einsum("k,kij->ij", value[:43], wrench_matrices(0.25))
    late = np.sin(2.0 * np.pi * np.array([3.0, 5.0, 7.0, 9.0, 11.0, 13.0]) * (t_s[:, None] - 2e-3))
    np.testing.assert_allclose(corrected(late @ matrix.T, 350.0, value, 0.25), wrench, atol=1e-9)


def test_axes_and_reference_are_what_a_small_turn_and_a_small_shift_do() -> None:
    errors = errors_of(UncertaintySettings())
    matrices, small, wrench = wrench_matrices(0.25), 1e-6, np.arange(1.0, 7.0)
    for axis, place in enumerate(errors.where("axes")):
        R_PS = Rotation.from_rotvec(small * np.eye(3)[axis]).as_matrix()
        turned = np.kron(np.eye(2), R_PS.T) @ wrench
        np.testing.assert_allclose((turned - wrench) / small, matrices[place] @ wrench, atol=1e-5)
    for axis, place in enumerate(errors.where("reference")):
        shifted = wrench.copy()
        shifted[3:] -= np.cross(small * np.eye(3)[axis], wrench[:3])
        np.testing.assert_allclose((shifted - wrench) / small, matrices[place] @ wrench, atol=1e-9)
