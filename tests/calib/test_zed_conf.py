"""A ZED's factory calibration: what of the file is taken, which way the pair turns, and what is refused."""

import csv
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.files import CalibrationError, load_calibration, parse_calibration, save_calibration
from calib.nominal import NOMINAL_RESIDUAL, uncalibrated_unit
from calib.zed_conf import ZED_MODES, load_zed_conf, with_factory_pair
from messages import StereoCalibration, UserError
from messages.arrays import FloatArray
from perception.depth.rectify import Rectifier
from tests.bench.data_folder import shared_data
from tests.bench.zed_conf_file import LEFT, RIGHT, Sections, conf, sections, text_of


def refusal(folder: Path, content: Sections | str, mode: str = "HD") -> str:
    path = conf(folder, content)
    with pytest.raises(CalibrationError) as caught:
        load_zed_conf(path, mode)
    line = str(caught.value)
    assert "\n" not in line
    return line.replace(str(path), "f")


# What is taken.


def test_lenses_and_pair_are_those_of_the_file(tmp_path: Path) -> None:
    stereo = load_zed_conf(conf(tmp_path, sections()), "HD")
    for lens, side in ((stereo.left, LEFT), (stereo.right, RIGHT)):
        assert (lens.width_px, lens.height_px) == (1280, 720)
        assert (lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px) == (side["fx"], side["fy"], side["cx"], side["cy"])
        assert lens.distortion == (side["k1"], side["k2"], side["p1"], side["p2"], 0.0)
    assert stereo.X_RL.p_m == pytest.approx((-0.119978, 2.6e-5, 1.59e-5))
    assert Rotation.from_matrix(stereo.X_RL.R).as_rotvec() == pytest.approx((-0.0009, 0.0062, 0.00077))
    assert stereo.row_time_s == pytest.approx(1 / 60 / 720)


def test_a_cameras_calibration_by_opencv_and_the_makers_writer_comes_back(tmp_path: Path) -> None:
    """The writer's rule: Baseline = -T_x, TY = T_y, TZ = T_z and the rotation vector, of x_R = R x_L + T."""
    R, T_mm = Rotation.from_rotvec((0.004, -0.009, 0.002)), (-119.7, 0.31, -0.47)
    content = sections()
    rx, cv, rz = R.as_rotvec().tolist()
    content["STEREO"] = {"Baseline": -T_mm[0], "TY": T_mm[1], "TZ": T_mm[2], "RX_HD": rx, "CV_HD": cv, "RZ_HD": rz}
    X_RL = load_zed_conf(conf(tmp_path, content), "HD").X_RL
    p_LP_m = np.array((0.2, 0.3, 1.1))
    seen_m = np.array(X_RL.R) @ p_LP_m + np.array(X_RL.p_m)
    np.testing.assert_allclose(seen_m, R.apply(p_LP_m) + np.array(T_mm) * 1e-3, atol=1e-12)


@pytest.mark.parametrize("mode", list(ZED_MODES))
def test_each_mode_has_its_sections_and_size(tmp_path: Path, mode: str) -> None:
    width_px, height_px, _ = ZED_MODES[mode]
    content = sections(mode)
    for side in ("LEFT", "RIGHT"):
        content[f"{side}_CAM_{mode}"] |= {"fx": 0.55 * width_px, "fy": 0.55 * width_px, "cx": width_px / 2}
        content[f"{side}_CAM_{mode}"] |= {"cy": height_px / 2}
    stereo = load_zed_conf(conf(tmp_path, content), mode)
    assert (stereo.right.width_px, stereo.right.height_px) == (width_px, height_px)
    assert 1e-6 < stereo.row_time_s < 1e-4


@pytest.mark.parametrize(
    "change",
    [
        str.lower,
        str.upper,
        lambda text: "\ufeff" + text.replace("=", " = ").replace("\n", "\r\n"),
        lambda text: text.replace("TY=", "TY_HD=").replace("TZ=", "TZ_HD="),
        lambda text: "# a comment\n" + text + "[MISC]\nSensor_ID=0\n",
        lambda text: text.replace("k3=0.0\n", ""),
    ],
    ids=["lower case", "upper case", "BOM and spaces", "offsets by mode", "further sections", "four terms"],
)
def test_the_ways_in_which_files_differ_do_not_matter(tmp_path: Path, change: object) -> None:
    assert callable(change)
    usual = load_zed_conf(conf(tmp_path, sections()), "HD")
    odd = load_zed_conf(conf(tmp_path, change(text_of(sections()))), "HD")
    assert odd.X_RL == usual.X_RL
    assert odd.left.distortion[:4] == usual.left.distortion[:4]


def test_eight_terms_and_distortion_of_its_own_section_are_read(tmp_path: Path) -> None:
    content = sections()
    terms = {f"k{number}": 0.01 * number for number in range(1, 7)} | {"p1": 1e-4, "p2": -2e-4}
    for side in ("LEFT", "RIGHT"):
        content[f"{side}_CAM_HD"] = {key: value for key, value in LEFT.items() if key[0] not in "kp"}
        content[f"{side}_DISTO"] = terms
    stereo = load_zed_conf(conf(tmp_path, content), "HD")
    assert stereo.right.distortion == pytest.approx((0.01, 0.02, 1e-4, -2e-4, 0.03, 0.04, 0.05, 0.06))


# What is refused.


def changed(section: str, key: str, value: object) -> str:
    content = {name: dict(keys) for name, keys in sections().items()}
    content[section][key] = 424242.0
    return text_of(content).replace("424242.0", str(value))


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (changed("LEFT_CAM_HD", "fx", 12), "f: [LEFT_CAM_HD] fx is 12, allowed 256 to 3840 px"),
        (changed("RIGHT_CAM_HD", "cy", -3), "f: [RIGHT_CAM_HD] cy is -3, allowed 0 to 719 px"),
        (changed("RIGHT_CAM_HD", "k1", "nan"), "f: [RIGHT_CAM_HD] k1 is nan, allowed -10 to 10"),
        (changed("LEFT_CAM_HD", "fx", "701,88"), "f: [LEFT_CAM_HD] fx is '701,88', which is no number"),
        (changed("STEREO", "RX_HD", 0.5), "f: [STEREO] RX_HD is 0.5, allowed -0.2 to 0.2 rad"),
        (changed("STEREO", "TZ", 30), "f: [STEREO] TZ is 30, allowed -20 to 20 mm"),
        (changed("STEREO", "Baseline", -120), "f: [STEREO] Baseline is -120, allowed 20 to 500 mm"),
        (
            changed("STEREO", "Baseline", 0.12),
            "f: [STEREO] Baseline is 0.12, which looks like metres; the file's lengths are mm, allowed 20 to 500 mm",
        ),
        (text_of(sections()).replace("CV_HD", "CV_VGA"), "f: [STEREO] CV_HD is missing"),
        (
            text_of(sections("VGA")),
            "f: section [LEFT_CAM_HD] is missing; there are LEFT_CAM_VGA, RIGHT_CAM_VGA, STEREO",
        ),
        ("", "f: section [LEFT_CAM_HD] is missing; there are none"),
        (
            "".join(f"{line}\n" for line in text_of(sections()).splitlines() if not line.startswith(("k", "p"))),
            "f: [LEFT_CAM_HD] k1 is missing",
        ),
    ],
)
def test_a_wrong_number_is_one_line_with_section_key_and_range(tmp_path: Path, text: str, line: str) -> None:
    assert refusal(tmp_path, text) == line


@pytest.mark.parametrize("text", ["fx=1\n", "[LEFT_CAM_HD]\nfx=1\nfx=2\n", "[A]\n[A]\n", "[A]\n\0\x01 what\n"])
def test_what_is_no_ini_file_is_one_line(tmp_path: Path, text: str) -> None:
    assert refusal(tmp_path, text).startswith("f: no .conf file of a ZED: ")


def test_lenses_without_distortion_are_refused(tmp_path: Path) -> None:
    content = sections()
    content["LEFT_CAM_HD"] |= dict.fromkeys(("k1", "k2", "p1", "p2", "k3"), 0.0)
    assert refusal(tmp_path, content) == "f: [LEFT_CAM_HD] k1, k2, p1, p2, k3 are all 0, as no lens of a ZED is"


def test_modes_and_missing_files_are_told(tmp_path: Path) -> None:
    assert refusal(tmp_path, sections(), "4K") == "mode is '4K', allowed 2K, FHD, HD, VGA"
    with pytest.raises(UserError, match=r"nowhere\.conf: No such file"):
        load_zed_conf(tmp_path / "nowhere.conf", "HD")


# The unit around it.


def test_a_unit_of_factory_values_alone_survives_its_file_and_says_what_it_does_not_know(tmp_path: Path) -> None:
    made = uncalibrated_unit("SN1234 HD, rest nominal", load_zed_conf(conf(tmp_path, sections()), "HD"))
    save_calibration(tmp_path / "calibration.yaml", made)
    loaded = load_calibration(tmp_path / "calibration.yaml")
    assert loaded == made
    assert loaded.id == made.id
    assert made.residual == NOMINAL_RESIDUAL
    # level walking, camera 45° down: B is pitched as the camera is
    p_BE_m = np.array(made.X_BL.R) @ np.array((0.0, 0.0, 1.0))
    np.testing.assert_allclose(p_BE_m, (1.0, 0.0, 0.0))


def test_only_the_pair_is_exchanged_in_a_known_unit(tmp_path: Path) -> None:
    factory = load_zed_conf(conf(tmp_path, sections()), "HD")
    known = uncalibrated_unit("hip", factory)
    known = msgspec.structs.replace(
        known,
        stereo=msgspec.structs.replace(factory, row_time_s=1.9e-5, stamp_to_mid_exposure_s=-0.011),
        residual=msgspec.structs.replace(NOMINAL_RESIDUAL, toe_in_rad=1e-4, time_s=5e-4, camera_to_imu_rad=1e-3),
    )
    wider = msgspec.structs.replace(factory, X_RL=msgspec.structs.replace(factory.X_RL, p_m=(-0.1205, 0.0, 0.0)))
    made = with_factory_pair(known, wider, None)
    assert made.stereo == msgspec.structs.replace(wider, row_time_s=1.9e-5, stamp_to_mid_exposure_s=-0.011)
    assert (made.unit, made.imu, made.X_BL) == ("hip", known.imu, known.X_BL)
    assert (made.residual.time_s, made.residual.camera_to_imu_rad) == (5e-4, 1e-3)
    assert made.residual.toe_in_rad == NOMINAL_RESIDUAL.toe_in_rad

    content = sections("VGA")
    for side in ("LEFT", "RIGHT"):
        content[f"{side}_CAM_VGA"] |= {"fx": 350.0, "fy": 350.0, "cx": 336.0, "cy": 180.0}
    vga = load_zed_conf(conf(tmp_path, content), "VGA")
    made = with_factory_pair(known, vga, "other")
    assert (made.unit, made.stereo, made.residual.time_s) == ("other", vga, NOMINAL_RESIDUAL.time_s)


# Real units.


def real_units() -> dict[str, Sections]:
    """Return the quoted units whose pair is known, as sections of a file."""
    found: dict[str, Sections] = {}
    with (shared_data("zed_factory_calibration") / "zed_hd720.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if not row["baseline_mm"]:
                continue
            lens = {key: float(row[key] or 0.0) for key in ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")}
            unit = found.setdefault(row["unit"], {})
            unit[f"{row['side'].upper()}_CAM_HD"] = lens
            unit["STEREO"] = {
                "Baseline": float(row["baseline_mm"]),
                "TY": float(row["TY_mm"]),
                "TZ": float(row["TZ_mm"]),
                "RX_HD": float(row["RX"]),
                "CV_HD": float(row["CV"]),
                "RZ_HD": float(row["RZ"]),
            }
    return found


def project(points_L_m: FloatArray, stereo: StereoCalibration) -> tuple[FloatArray, FloatArray]:
    """Return the raw pixels (points, 2) of both eyes, by the camera model written out: pinhole after distortion."""
    eyes = []
    for lens, points_m in (
        (stereo.left, points_L_m),
        (stereo.right, points_L_m @ np.array(stereo.X_RL.R).T + np.array(stereo.X_RL.p_m)),
    ):
        x, y = points_m[:, 0] / points_m[:, 2], points_m[:, 1] / points_m[:, 2]
        k1, k2, p1, p2, k3 = lens.distortion
        r2 = x**2 + y**2
        radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        u = lens.fx_px * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)) + lens.cx_px
        v = lens.fy_px * (y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y) + lens.cy_px
        eyes.append(np.stack((u, v), axis=-1))
    return eyes[0], eyes[1]


def points_on_the_ground(stereo: StereoCalibration) -> FloatArray:
    """Return points (…, 3) of a plane 0.9 m under a camera pitched 45° down, which both eyes see."""
    v, u = np.mgrid[60:660:40, 200:1240:40]
    rays = np.stack(((u - 640) / 700, (v - 360) / 700, np.ones(u.shape)), axis=-1).reshape(-1, 3)
    down_L = np.array((0.0, np.sqrt(0.5), np.sqrt(0.5)))
    depth = 0.9 / (rays @ down_L)
    points_m = (rays * depth[:, None])[(depth > 0.5) & (depth < 3.0)]
    left, right = project(points_m, stereo)
    seen = np.all((left > 5) & (left < (1275, 715)) & (right > 5) & (right < (1275, 715)), axis=1)
    return np.asarray(points_m[seen])


@pytest.mark.parametrize("unit", ["SN21531", "SN10027514", "unnamed"])
def test_rectified_rows_of_a_real_unit_agree(tmp_path: Path, unit: str) -> None:
    """In both eyes one rectified row shows the raw pixels where the camera model, written out above, sees a point."""
    stereo = load_zed_conf(conf(tmp_path, real_units()[unit]), "HD")
    points_m = points_on_the_ground(stereo)
    raw_px = project(points_m, stereo)
    assert len(points_m) > 100
    assert np.abs(raw_px[0][:, 1] - raw_px[1][:, 1]).max() > 5.0

    rectifier = Rectifier(stereo, divisor=1)
    x_C, y_C, z_C = (points_m @ rectifier.R_LC).T
    row = rectifier.f_px * y_C / z_C + rectifier.cy_px
    column = rectifier.f_px * x_C / z_C + rectifier.cx_px
    disparity_px = rectifier.f_px * rectifier.baseline_m / z_C
    eyes = (rectifier.left_maps, raw_px[0], column), (rectifier.right_maps, raw_px[1], column - disparity_px)
    for maps, pixels, u in eyes:
        inside = (u > 1) & (u < 1278) & (row > 1) & (row < 718)
        seat = u[inside].astype(np.float32), row[inside].astype(np.float32)
        shown = np.stack([np.ravel(cv2.remap(axis, *seat, cv2.INTER_LINEAR)) for axis in maps], axis=-1)
        assert inside.sum() > 100
        assert np.abs(shown - pixels[inside]).max() < 0.05


@pytest.mark.parametrize("unit", ["SN21531", "SN10027514", "unnamed"])
def test_the_makers_own_rectification_agrees_with_the_direction_of_the_rotation(tmp_path: Path, unit: str) -> None:
    """The maker rectifies with stereoRectify(R = Rodrigues(RX, CV, RZ), T = (Baseline, TY, TZ)).

    Its result does not depend on the sign of T as a whole, so for the rotation it is a witness. Seen through our X_RL
    the rows of its rectified pair agree but for the signs of TY and TZ, which are below 0.3°; were the rotation the
    other way they would not.
    """
    content = real_units()[unit]
    stereo = load_zed_conf(conf(tmp_path, content), "HD")
    pair = content["STEREO"]
    R, _ = cv2.Rodrigues(np.array((pair["RX_HD"], pair["CV_HD"], pair["RZ_HD"])))
    T = np.array((pair["Baseline"], pair["TY"], pair["TZ"])).reshape(3, 1)
    K = [
        np.array([[lens.fx_px, 0, lens.cx_px], [0, lens.fy_px, lens.cy_px], [0, 0, 1]])
        for lens in (stereo.left, stereo.right)
    ]
    D = [np.array(lens.distortion) for lens in (stereo.left, stereo.right)]
    R1, R2, P1, P2, *_ = cv2.stereoRectify(
        K[0], D[0], K[1], D[1], (1280, 720), R, T, flags=cv2.CALIB_ZERO_DISPARITY, alpha=0
    )
    points_m = points_on_the_ground(stereo)

    def rows_off_px(of: StereoCalibration) -> float:
        eyes = project(points_m, of)
        rectified = [
            np.asarray(cv2.undistortPoints(eye.reshape(-1, 1, 2), k, d, R=r, P=p)).reshape(-1, 2)
            for eye, k, d, r, p in zip(eyes, K, D, (R1, R2), (P1, P2), strict=True)
        ]
        return float(np.abs(rectified[0][:, 1] - rectified[1][:, 1]).max())

    other_way = msgspec.structs.replace(
        stereo, X_RL=msgspec.structs.replace(stereo.X_RL, R=tuple(map(tuple, np.array(stereo.X_RL.R).T.tolist())))
    )
    assert rows_off_px(stereo) < 0.7
    assert rows_off_px(other_way) > 3.0 * rows_off_px(stereo)


def test_a_real_unit_survives_its_calibration_file(tmp_path: Path) -> None:
    for name, content in real_units().items():
        made = uncalibrated_unit(name, load_zed_conf(conf(tmp_path, content), "HD"))
        save_calibration(tmp_path / f"{name}.yaml", made)
        assert parse_calibration((tmp_path / f"{name}.yaml").read_text(), name) == made
