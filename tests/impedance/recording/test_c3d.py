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

OwnPlatform = tuple[FloatArray, list[str], list[tuple[str, FloatArray | list[int]]]]
"""Channels (n, c), their units, and the parameters of group FORCE_PLATFORM."""

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


def write(
    recording: PlatformRecording, folder: Path, platform: OwnPlatform | None = None, **changes: object
) -> tuple[Path, Path]:
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
    if platform is not None:
        channels, units, group = platform
        parameters["ANALOG"]["LABELS"]["value"] = [f"C{k}" for k in range(channels.shape[1])]
        parameters["ANALOG"]["UNITS"]["value"] = units
        file["data"]["analogs"] = channels.T[None]
        for name, value in group:
            file.add_parameter("FORCE_PLATFORM", name, value)
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


CENTRE_IN_LAB_M = LAB_OF_I @ np.array([0.0, 0.12, 0.0]) + JOINT_IN_LAB_M
PLATFORM_AXES = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""The force platform's x, y, z in the laboratory: z into the ground."""
HALF_SIDES_M = np.array([0.3, 0.2])
ORIGINS_MM = {2: (5.0, -3.0, -40.0), 3: (250.0, 150.0, -35.0), 4: (5.0, -3.0, 40.0)}


def sensors_to_wrench() -> FloatArray:
    """Return the matrix (6, 8) of a piezo-electric plate's channels, out of where its four sensors are."""
    a, b, z = 0.25, 0.15, 0.035
    columns = []
    for axis, (x, y) in (
        *((0, (0.0, each)) for each in (b, -b)),
        *((1, (each, 0.0)) for each in (a, -a)),
        *((2, place) for place in ((a, b), (-a, b), (-a, -b), (a, -b))),
    ):
        force = np.eye(3)[axis]
        columns.append(np.concatenate((force, np.cross([x, y, z], force))))
    matrix: FloatArray = np.array(columns).T
    return matrix


def as_platform(recording: PlatformRecording, kind: int) -> OwnPlatform:
    """Return the wrench as channels of the file's own force platform, their units, and the group's parameters."""
    turned = PLATFORM_AXES @ LAB_OF_I
    on_plate = -np.hstack((recording.wrench[:, :3] @ turned.T, recording.wrench[:, 3:] @ turned.T))
    rng = np.random.default_rng(kind)
    matrix = np.diag(rng.uniform(50.0, 200.0, 6)) + rng.normal(size=(6, 6))
    if kind == 3:
        channels, units = on_plate @ np.linalg.pinv(sensors_to_wrench()).T, ["Newtons"] * 8
    else:
        origin_m = (
            -np.abs(np.array(ORIGINS_MM[kind])) * (1, -1, 1) * 1e-3 if kind == 4 else np.array(ORIGINS_MM[2]) / 1e3
        )
        channels = on_plate.copy()
        channels[:, 3:] += np.cross(origin_m, on_plate[:, :3])
        channels[:, 3:] *= 1000.0
        units = ["Newton"] * 3 + ["newton-millimetres"] * 3
        if kind == 4:
            channels, units = np.linalg.solve(matrix, channels.T).T, ["V"] * 6
    corners = [CENTRE_IN_LAB_M + HALF_SIDES_M * s @ PLATFORM_AXES[:2] for s in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    parameters: list[tuple[str, FloatArray | list[int]]] = [
        ("TYPE", [kind]),
        ("CORNERS", 1000.0 * np.array(corners).T[:, :, None]),
        ("ORIGIN", np.array(ORIGINS_MM[kind])[:, None]),
        ("CHANNEL", 1.0 + np.arange(channels.shape[1])[:, None]),
    ]
    return channels, units, [*parameters, ("CAL_MATRIX", matrix[:, :, None])] if kind == 4 else parameters


@pytest.mark.parametrize("kind", [2, 3, 4])
def test_the_files_own_force_platform_tells_the_wrench(recording: PlatformRecording, tmp_path: Path, kind: int) -> None:
    path, layout = write(recording, tmp_path, unit="millimeters", platform=as_platform(recording, kind))
    text = layout.read_text().replace(f"channels = {list(CHANNELS)}", "force_platform = 1")
    layout.write_text(text.replace(f"sensor_in_plate_m = {SENSOR_IN_PLATE_M.tolist()}", ""))
    np.testing.assert_allclose(read_c3d(path, layout).wrench, recording.wrench, atol=2e-3)
    layout.write_text(layout.read_text().replace("force_platform = 1", "force_platform = 2"))
    with pytest.raises(UserError, match=r"holds 1 platforms, c3d\.force_platform is 2"):
        read_c3d(path, layout)
    layout.write_text(layout.read_text().replace("force_platform = 2", ""))
    with pytest.raises(UserError, match="one of the two is needed"):
        read_c3d(path, layout)


def test_a_label_that_stands_twice_is_refused(recording: PlatformRecording, tmp_path: Path) -> None:
    twice = ["Fx1", "Fy1", "Fz1", "Mx1", "My1", "Fx1"]
    path, layout = write(recording, tmp_path, channels=twice)
    layout.write_text(layout.read_text().replace("'Mz1'", "'My1'"))
    with pytest.raises(UserError, match="channel Fx1 is there 2 times"):
        read_c3d(path, layout)


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
    with pytest.raises(UserError, match="POINT:UNITS is 'inch', allowed m, cm, mm, meters"):
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
