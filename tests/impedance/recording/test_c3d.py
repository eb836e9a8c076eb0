"""C3D files: markers become poses, channels the wrench, whatever axes and units the laboratory uses."""

from pathlib import Path

import numpy as np
import pytest

from impedance.body import geometry
from impedance.recording.c3d import pose_of_markers, read_c3d
from impedance.recording.recording import PlatformRecording, Poses
from messages.arrays import FloatArray
from messages.errors import UserError

pytest.importorskip("ezc3d")
pytest.importorskip("mujoco")

import ezc3d

from sim_rig.platform.rig import FOOT, PLATE, Rig
from sim_rig.platform.run import RunSettings, measured, simulate

PLATE_MARKERS = {"P1": (0.2, 0.0, 0.1), "P2": (-0.2, 0.0, 0.1), "P3": (-0.2, 0.0, -0.1), "P4": (0.2, 0.01, -0.1)}
FOOT_MARKERS = {"F1": (0.05, 0.0, 0.05), "F2": (-0.05, 0.0, 0.05), "F3": (0.0, 0.02, -0.06)}
CHANNELS = ("Fx1", "Fy1", "Fz1", "Mx1", "My1", "Mz1")
JOINT_IN_LAB_M = np.array([0.5, -0.3, 0.1])
SENSOR_IN_PLATE_M = np.array([0.01, -0.04, 0.02])
LAB_OF_I = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # I's X, Y, Z are the laboratory's y, z, x

LAYOUT = f"""
[c3d]
channels = {list(CHANNELS)}
lab_axes = ["y", "z", "x"]
joint_in_lab_m = {JOINT_IN_LAB_M.tolist()}
sensor_in_plate_m = {SENSOR_IN_PLATE_M.tolist()}
reaction = true
[c3d.plate_markers]
{chr(10).join(f"{name} = {list(place)}" for name, place in PLATE_MARKERS.items())}
[c3d.foot_markers]
{chr(10).join(f"{name} = {list(place)}" for name, place in FOOT_MARKERS.items())}
"""


@pytest.fixture(scope="module")
def recording() -> PlatformRecording:
    run = simulate(RunSettings(rig=Rig(foot=FOOT), duration_s=4.0), seed=9)
    return measured(run, noise=None, plate=PLATE)


def in_lab(poses: Poses, markers: dict[str, tuple[float, float, float]]) -> FloatArray:
    """Return the markers (n, k, 3) in the laboratory, in metres."""
    R = geometry.rotation_IP(*poses.euler_rad.T)
    seen_I = poses.p_m[:, None] + np.einsum("nij,kj->nki", R, np.array(list(markers.values())))
    seen: FloatArray = seen_I @ LAB_OF_I.T + JOINT_IN_LAB_M
    return seen


def write(recording: PlatformRecording, folder: Path, **changes: object) -> tuple[Path, Path]:
    """Write the recording as a laboratory's C3D file and its layout."""
    assert recording.foot is not None
    recording.save(folder)
    layout = folder / "layout.toml"
    layout.write_text((folder / "platform.toml").read_text() + LAYOUT)
    points = np.concatenate((in_lab(recording.plate, PLATE_MARKERS), in_lab(recording.foot, FOOT_MARKERS)), axis=1)
    points[100:110, 3] = np.nan  # one marker of four hidden: the pose is still known
    points[200:205, 5] = np.nan  # one of three: it is not
    force, moment = recording.wrench[:, :3], recording.wrench[:, 3:]
    about_sensor = -np.hstack((force, moment - np.cross(SENSOR_IN_PLATE_M, force))) * np.repeat((1.0, 1000.0), 3)
    file = ezc3d.c3d()
    parameters = file["parameters"]
    parameters["POINT"]["RATE"]["value"] = [350.0]
    parameters["POINT"]["UNITS"]["value"] = [changes.get("unit", "mm")]
    parameters["POINT"]["LABELS"]["value"] = [*PLATE_MARKERS, *FOOT_MARKERS]
    parameters["ANALOG"]["RATE"]["value"] = [350.0]
    parameters["ANALOG"]["LABELS"]["value"] = changes.get("channels", list(CHANNELS))
    parameters["ANALOG"]["UNITS"]["value"] = ["N"] * 3 + ["Nmm"] * 3
    file["data"]["points"] = np.concatenate((1000.0 * points, np.ones((*points.shape[:2], 1))), axis=2).transpose(
        2, 1, 0
    )
    file["data"]["analogs"] = about_sensor.T[None]
    path = folder / "trial.c3d"
    file.write(str(path))
    return path, layout


def test_a_c3d_file_comes_back_as_the_recording_it_was(recording: PlatformRecording, tmp_path: Path) -> None:
    found = read_c3d(*write(recording, tmp_path))
    assert found.foot is not None
    assert recording.foot is not None
    seen = np.r_[0:200, 205 : len(recording.t_s)]
    np.testing.assert_allclose(found.plate.p_m, recording.plate.p_m, atol=1e-6)
    np.testing.assert_allclose(found.plate.euler_rad, recording.plate.euler_rad, atol=5e-6)
    np.testing.assert_allclose(found.foot.p_m[seen], recording.foot.p_m[seen], atol=1e-6)
    assert np.isnan(found.foot.p_m[200:205]).all()
    np.testing.assert_allclose(found.wrench, recording.wrench, atol=1e-3)
    assert found.settings == recording.settings
    assert any("foot_x_m is NaN in 5 rows" in note for note in found.notes)


def test_what_a_c3d_file_lacks_is_named(recording: PlatformRecording, tmp_path: Path) -> None:
    path, layout = write(recording, tmp_path)
    text = layout.read_text()
    for old, new, said in (
        ("'Fx1'", "'Fx9'", "channel Fx9 is missing; it holds Fx1"),
        ("P1 = ", "P9 = ", "marker P9 is missing; it holds P1"),
        ('["y", "z", "x"]', '["y", "x", "z"]', "c3d.lab_axes: three right-handed axes"),
        ("reaction = true", "reaction = false", "reversed sign"),
        (
            "F3 = [0.0, 0.02, -0.06]",
            "F3 = [0.0, 0.0, 0.05]",
            "c3d.foot_markers: three markers or more that are not in line",
        ),
        ("c3d", "c4d", "has no table [c3d]"),
    ):
        layout.write_text(text.replace(old, new))
        with pytest.raises(UserError) as refused:
            read_c3d(path, layout)
        assert said in str(refused.value)
        assert "\n" not in str(refused.value)
    layout.write_text(text)
    for file, said in ((tmp_path / "none.c3d", "no such file"), (layout, "not a C3D file")):
        with pytest.raises(UserError, match=said):
            read_c3d(file, layout)


def test_a_wrong_unit_is_named(recording: PlatformRecording, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"millimetres|allowed 0\.12 m"):
        read_c3d(*write(recording, tmp_path, unit="m"))
    with pytest.raises(UserError, match="POINT:UNITS is 'inch', allowed m, cm, mm"):
        read_c3d(*write(recording, tmp_path, unit="inch"))


def test_a_pose_is_that_of_its_markers() -> None:
    rng = np.random.default_rng(0)
    euler, p = rng.uniform(-1.2, 1.2, (50, 3)), rng.normal(size=(50, 3))
    places = rng.normal(size=(5, 3))
    R = geometry.rotation_IP(*euler.T)
    seen = p[:, None] + np.einsum("nij,kj->nki", R, places)
    seen[::2, 0] = np.nan
    found_p, found_R = pose_of_markers(seen, places)
    np.testing.assert_allclose(found_p, p, atol=1e-12)
    np.testing.assert_allclose(found_R, R, atol=1e-12)
