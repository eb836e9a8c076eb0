import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calib.files import (
    check_calibration,
    check_frame_size,
    format_calibration,
    load_calibration,
    parse_calibration,
    save_calibration,
)
from messages import (
    Calibration,
    ImuCalibration,
    Lens,
    Pose,
    Residual,
    StereoCalibration,
    UserError,
    WearerHeight,
    matrix3,
    vec3,
)
from messages.arrays import FloatArray

IDENTITY = matrix3(np.eye(3))
DOCUMENT = """
unit: bench-7
imu:
  sf_matrix: [[1.01, 0.002, 0], [0, 0.99, 0], [0, 0, 1]]
  sf_bias_mps2: [0.1, -0.2, 0.3]
  w_matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
  w_bias_radps: [0.01, 2e-3, -1e-3]
stereo:
  left: {width_px: 1280, height_px: 720, fx_px: 700, fy_px: 700.5, cx_px: 640, cy_px: 360,
         distortion: [-0.17, 0.03, 1e-4, 0, 0]}
  right: {width_px: 1280, height_px: 720, fx_px: 701, fy_px: 700, cx_px: 639, cy_px: 361, distortion: [0, 0, 0, 0]}
  X_RL: {R: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], p_m: [-0.12, 0.001, -0.0005]}
  row_time_s: 22e-6
X_BL: {R: [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], p_m: [0, 0.06, 0]}
residual: {specific_force_mps2: 0.015, scale: 5e-4}
"""


def document(**changes: object) -> str:
    """The sample file with `a__b__0=value` put at a.b[0]."""
    data = msgspec.to_builtins(parse_calibration(DOCUMENT, "sample"))
    data = msgspec.json.decode(msgspec.json.encode(data))
    for path, value in changes.items():
        *way, last = (int(step) if step.isdigit() else step for step in path.split("__"))
        place = data
        for step in way:
            place = place[step]
        place[last] = value
    return yaml.safe_dump(data)


def complaint(text: str) -> str:
    with pytest.raises(UserError) as raised:
        parse_calibration(text, "unit.yaml")
    line = str(raised.value)
    assert line.startswith("unit.yaml: ")
    assert "\n" not in line
    return line.removeprefix("unit.yaml: ")


finite = {"allow_nan": False, "allow_infinity": False}


def within(limit: float) -> st.SearchStrategy[float]:
    return st.floats(-limit, limit, **finite)  # type: ignore[arg-type]


@st.composite
def rotations(draw: st.DrawFn, largest_rad: float = math.pi) -> FloatArray:
    axis = np.array([draw(within(1.0)) for _ in range(3)])
    norm = float(np.linalg.norm(axis))
    angle = draw(st.floats(0.0, largest_rad))
    rotvec = axis / norm * angle if norm > 1e-6 else np.zeros(3)
    return np.asarray(Rotation.from_rotvec(rotvec).as_matrix(), dtype=np.float64)


@st.composite
def lenses(draw: st.DrawFn, width_px: int, height_px: int, focal_px: float) -> Lens:
    terms = draw(st.sampled_from([4, 5, 8, 12, 14]))
    return Lens(
        width_px=width_px,
        height_px=height_px,
        fx_px=draw(st.floats(0.98 * focal_px, 1.02 * focal_px)),
        fy_px=draw(st.floats(0.98 * focal_px, 1.02 * focal_px)),
        cx_px=draw(st.floats(0.3, 0.7)) * width_px,
        cy_px=draw(st.floats(0.3, 0.7)) * height_px,
        distortion=tuple(draw(within(0.01)) for _ in range(terms)),
    )


@st.composite
def calibrations(draw: st.DrawFn) -> Calibration:
    width_px = draw(st.integers(16, 8192))
    height_px = draw(st.integers(max(16, width_px // 2), min(8192, 2 * width_px)))
    focal_px = draw(st.floats(0.7, 2.9)) * width_px
    baseline_m = draw(st.floats(0.021, 0.49))

    def near_identity() -> FloatArray:
        deviation: FloatArray = np.array([[draw(within(0.0999)) for _ in range(3)] for _ in range(3)])
        return deviation + np.eye(3)

    return Calibration(
        unit=draw(st.text(st.characters(categories=["L", "N", "P", "S"]), min_size=1, max_size=64)),
        imu=ImuCalibration(
            sf_matrix=matrix3(near_identity()),
            sf_bias_mps2=vec3([draw(within(2.0)) for _ in range(3)]),
            w_matrix=matrix3(near_identity()),
            w_bias_radps=vec3([draw(within(1.0)) for _ in range(3)]),
            temperature_degC=draw(st.just(msgspec.UNSET) | st.floats(-40.0, 85.0)),
        ),
        stereo=StereoCalibration(
            left=draw(lenses(width_px, height_px, focal_px)),
            right=draw(lenses(width_px, height_px, focal_px)),
            X_RL=Pose(R=matrix3(draw(rotations(0.19))), p_m=(-baseline_m, draw(within(0.001)), draw(within(0.001)))),
            row_time_s=draw(st.floats(0.0, 1e-4)),
            stamp_to_mid_exposure_s=draw(within(0.1)),
        ),
        X_BL=Pose(R=matrix3(draw(rotations())), p_m=vec3([draw(within(0.5)) for _ in range(3)])),
        residual=Residual(
            scale=draw(st.floats(0.0, 0.1)),
            time_s=draw(st.floats(0.0, 0.1)),
            focal_length=draw(st.just(msgspec.UNSET) | st.floats(0.0, 0.02)),
        ),
    )


@pytest.mark.long
@given(calibrations())
def test_a_written_calibration_reads_back_equal_to_the_last_bit(calibration: Calibration) -> None:
    read = parse_calibration(format_calibration(calibration), "memory")
    assert read == calibration
    assert read.id == calibration.id


@pytest.mark.long
@given(calibrations(), st.floats(-0.02, 0.02).filter(lambda skew: abs(skew) > 1e-4), st.integers(0, 8))
def test_a_skewed_rotation_is_refused(calibration: Calibration, skew: float, element: int) -> None:
    rows = np.array(calibration.X_BL.R)
    rows.flat[element] += skew
    skewed = msgspec.structs.replace(calibration, X_BL=Pose(R=matrix3(rows), p_m=calibration.X_BL.p_m))
    error = float(np.abs(rows.T @ rows - np.eye(3)).max())
    if error > 1e-6:
        with pytest.raises(UserError, match=r"X_BL\.R is no rotation"):
            check_calibration(skewed, "memory")


@given(st.text(max_size=200))
def test_any_text_at_all_gets_one_line(text: str) -> None:
    complaint(text)


@given(st.data())
def test_nan_and_infinity_are_refused_in_every_number(data: st.DataObject) -> None:
    numbers = [
        "imu__sf_matrix__0__1",
        "imu__w_bias_radps__2",
        "stereo__left__cx_px",
        "stereo__right__distortion__1",
        "stereo__X_RL__p_m__0",
        "stereo__X_RL__R__2__2",
        "X_BL__p_m__1",
        "residual__time_s",
        "stereo__stamp_to_mid_exposure_s",
    ]
    path = data.draw(st.sampled_from(numbers))
    value = data.draw(st.sampled_from([math.nan, math.inf, -math.inf]))
    line = complaint(document(**{path: value}))
    assert line.startswith(path.split("__")[0] + ".")
    assert f"is {value:g}" in line


def test_the_sample_is_read_with_numbers_as_people_write_them() -> None:
    calibration = parse_calibration(DOCUMENT, "sample")
    assert isinstance(calibration, Calibration)
    assert calibration.stereo.row_time_s == 22e-6
    assert calibration.imu.w_bias_radps == (0.01, 2e-3, -1e-3)
    assert calibration.stereo.left.distortion[2] == 1e-4
    assert calibration.residual.time_s == 0.0


def test_a_file_older_than_a_term_of_the_residual_keeps_its_id_and_leaves_what_is_usual() -> None:
    calibration = parse_calibration(DOCUMENT, "sample")
    assert calibration.id == "2dd26075"
    assert "focal_length" not in format_calibration(calibration)
    residual, imu = calibration.residual, calibration.imu
    assert (residual.focal_length_std, residual.baseline_std) == (3e-4, 2.5e-3)
    assert residual.sf_per_K_std_mps2 == pytest.approx(0.43e-3 * 9.80665, rel=0.01)
    assert imu.calibrated_at == (30.0, 5.0)


def test_what_a_file_states_of_them_is_taken() -> None:
    stated = parse_calibration(
        document(
            residual__focal_length=0.0,
            residual__baseline=0.01,
            residual__specific_force_mps2_per_K=0.002,
            imu__temperature_degC=21.5,
        ),
        "sample",
    )
    residual = stated.residual
    assert (residual.focal_length_std, residual.baseline_std, residual.sf_per_K_std_mps2) == (0.0, 0.01, 0.002)
    assert stated.imu.calibrated_at == (21.5, 0.0)
    assert stated.id != "2dd26075"


def test_a_file_is_replaced_in_one_step(tmp_path: Path) -> None:
    path = tmp_path / "unit.yaml"
    calibration = parse_calibration(DOCUMENT, "sample")
    save_calibration(path, calibration)
    renamed = msgspec.structs.replace(calibration, unit="bench-8")
    save_calibration(path, renamed)
    assert load_calibration(path) == renamed
    assert [found.name for found in tmp_path.iterdir()] == ["unit.yaml"]


def test_an_impossible_calibration_is_not_written(tmp_path: Path) -> None:
    calibration = parse_calibration(DOCUMENT, "sample")
    mirrored = Pose(R=matrix3(np.diag([1.0, 1.0, -1.0])), p_m=(0.0, 0.0, 0.0))
    with pytest.raises(UserError, match=r"X_BL\.R mirrors: its determinant is -1, allowed \+1"):
        save_calibration(tmp_path / "unit.yaml", msgspec.structs.replace(calibration, X_BL=mirrored))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"stereo__row_tim_s": 0.0}, "stereo.row_tim_s is not a known field; did you mean 'row_time_s'?"),
        ({"residual__zzz": 0.0}, "residual.zzz is not a known field; allowed: specific_force_mps2, scale, "),
        ({"stereo__left__fx_px": "wide"}, "stereo.left.fx_px is 'wide', allowed a number above 0"),
        ({"stereo__left__fx_px": -700.0}, "stereo.left.fx_px is -700.0, allowed a number above 0"),
        ({"stereo__left__fx_px": 99.0}, "stereo.left.fx_px is 99, allowed 256 to 3840 for pictures 1280 px wide"),
        ({"stereo__right__fy_px": 500.0}, "stereo.right.fy_px is 0.713 times fx_px, allowed 0.9 to 1.1 times"),
        (
            {"stereo__right__fx_px": 1000.0, "stereo__right__fy_px": 1000.0},
            "stereo.right.fx_px is 1.43 times stereo.left.fx_px, allowed 0.9 to 1.1 times",
        ),
        ({"stereo__left__distortion__0": 175.0}, "stereo.left.distortion[0] is 175, allowed -100 to 100"),
        (
            {"stereo__left__distortion__0": -1.7},
            "stereo.left.distortion scales the picture's corner by -0.834",
        ),
        ({"stereo__left__distortion__2": 1.0}, "stereo.left.distortion[2] is 1, allowed up to ±0.1: tangential"),
        (
            {"stereo__X_RL__R": Rotation.from_rotvec([0.0, 0.3, 0.0]).as_matrix().tolist()},
            "stereo.X_RL.R turns by 0.3 rad, allowed up to 0.2: the eyes look one way",
        ),
        ({"imu__sf_bias_mps2__0": 4.0}, "imu.sf_bias_mps2[0] is 4, allowed -2 to 2"),
        ({"imu__temperature_degC": 98.6}, "imu.temperature_degC is 98.6, allowed -40 to 85"),
        ({"residual__focal_length": 3.0}, "residual.focal_length is 3, allowed 0 to 0.02"),
        ({"residual__baseline": -0.1}, "residual.baseline is -0.1, allowed 0 to 0.05"),
        ({"residual__specific_force_mps2_per_K": 1.0}, "residual.specific_force_mps2_per_K is 1, allowed 0 to 0.05"),
        ({"stereo__left__width_px": 8}, "stereo.left.width_px is 8, allowed 16 to 8192"),
        ({"stereo__left__cx_px": 1280.0}, "stereo.left.cx_px is 1280, allowed 384 to 896 of 1280 px"),
        ({"stereo__right__cy_px": -1.0}, "stereo.right.cy_px is -1, allowed 216 to 504 of 720 px"),
        ({"stereo__left__distortion": [0.0] * 3}, "stereo.left.distortion has 3 terms, allowed 4, 5, 8, 12, 14"),
        (
            {"stereo__right__width_px": 1920},
            "stereo.right is 1920x720 px, stereo.left 1280x720 px: both must be equal",
        ),
        ({"stereo__X_RL__p_m": [0.12, 0.0, 0.0]}, "stereo.X_RL.p_m[0] is 0.12 m, allowed below 0: left and right"),
        ({"stereo__X_RL__p_m": [-120.0, 0.0, 0.0]}, "stereo.X_RL.p_m has the length 120 m, allowed 0.02 to 0.5 m"),
        ({"stereo__X_RL__p_m": [0.0, 0.12, 0.0]}, "stereo.X_RL.p_m[0] is 0 m of a baseline of 0.12 m: the cameras"),
        ({"stereo__X_RL__p_m": [-0.12, 0.0]}, "stereo.X_RL.p_m: expected `array` of length 3"),
        ({"stereo__X_RL__R__0__0": 0.9}, "stereo.X_RL.R is no rotation: off orthonormal by 0.19, allowed up to 1e-06"),
        ({"imu__sf_matrix__1__1": 1.2}, "imu.sf_matrix[1][1] is 1.2, allowed 0.9 to 1.1"),
        ({"imu__w_matrix__0__2": -0.2}, "imu.w_matrix[0][2] is -0.2, allowed -0.1 to 0.1"),
        ({"imu__w_bias_radps__0": 20.0}, "imu.w_bias_radps[0] is 20, allowed -1 to 1"),
        ({"residual__scale": -0.1}, "residual.scale is -0.1, allowed 0 to 0.1"),
        ({"X_BL__p_m__2": 60.0}, "X_BL.p_m[2] is 60, allowed -0.5 to 0.5"),
        ({"unit": ""}, "unit is '', allowed 1 to 64 printable characters"),
        ({"stereo__left__cx_px": True}, "stereo.left.cx_px is True, allowed a number"),
        (
            {"stereo__left__cx_px": 10**400},
            "stereo.left.cx_px is a whole number of 1329 bits, allowed 64",
        ),
    ],
)
def test_what_is_wrong_is_named_with_its_place_and_range(changes: dict[str, object], line: str) -> None:
    assert complaint(document(**changes)).startswith(line)


def test_a_missing_field_is_named() -> None:
    assert complaint(DOCUMENT.replace("unit: bench-7", "")) == "unit is missing"
    assert complaint(DOCUMENT.replace("cy_px: 360,", "")) == "stereo.left.cy_px is missing"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "the file: expected `object`, got `null`"),
        ("- 1\n", "the file: expected `object`, got `array`"),
        ("unit: a\nunit: b\n", "line 2: key 'unit' stands twice"),
        ("unit: &a x\nimu: *a\n", "line 2: aliases are not allowed"),
        ("unit: [1, 2\n", "line 2: "),
        ("unit: 2020-99-99\n", "imu is missing"),
        ("unit: !!timestamp x\n", "line 1: tags are not allowed"),
        ("unit: !!bool x\n", "line 1: tags are not allowed"),
        ("[a]: 1\n", "line 1: a key must be text"),
        ("unit: " + "[" * 500, "line 1: nested deeper than 32 levels"),
        ("unit: " + "9" * 5000 + "\n", "Exceeds the limit"),
        ("a" * 5000 + ": 1\n", "line 1: "),
        ('"a\\nb": 1\n', r"a\nb is not a known field"),
    ],
)
def test_text_that_is_no_calibration_gets_one_line(text: str, line: str) -> None:
    assert complaint(text).startswith(line)


def test_files_that_cannot_be_read_get_one_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"absent\.yaml: No such file or directory; `gaiteyes init` makes"):
        load_calibration(tmp_path / "absent.yaml")
    with pytest.raises(UserError, match=r"Is a directory$"):
        load_calibration(tmp_path)
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"unit: \xff\xfe")
    with pytest.raises(UserError, match=r"binary\.yaml: not UTF-8 text \(byte 6\)$"):
        load_calibration(binary)


def test_frames_of_another_size_are_named() -> None:
    calibration = parse_calibration(DOCUMENT, "sample")
    check_frame_size(calibration, 1280, 720, "/dev/video0")
    with pytest.raises(UserError) as raised:
        check_frame_size(calibration, 752, 480, "/dev/video0")
    assert str(raised.value) == "calibration 'bench-7' is for 1280x720 px, /dev/video0 delivers 752x480 px"


def test_a_file_without_a_wearer_has_the_id_and_the_text_that_it_had_before() -> None:
    calibration = parse_calibration(DOCUMENT, "unit.yaml")
    assert calibration.wearer is msgspec.UNSET
    assert calibration.id == "2dd26075"
    assert "wearer" not in format_calibration(calibration)


def test_the_wearers_height_is_kept_and_changes_the_id(tmp_path: Path) -> None:
    calibration = parse_calibration(DOCUMENT, "unit.yaml")
    worn = msgspec.structs.replace(calibration, wearer=WearerHeight(camera_height_m=0.97, std_m=0.005))
    save_calibration(tmp_path / "unit.yaml", worn)
    assert load_calibration(tmp_path / "unit.yaml") == worn
    assert worn.id != calibration.id


@pytest.mark.parametrize(
    ("wearer", "line"),
    [
        ({"camera_height_m": 0.49, "std_m": 0.005}, "wearer.camera_height_m is 0.49, allowed 0.5 to 1.6"),
        ({"camera_height_m": math.nan, "std_m": 0.005}, "wearer.camera_height_m is nan, allowed 0.5 to 1.6"),
        ({"camera_height_m": 0.97, "std_m": 0.0}, "wearer.std_m is 0, allowed 0.0001 to 0.1"),
        ({"camera_height_m": 0.97}, "wearer.std_m is missing"),
        ({"camera_hight_m": 0.97}, "wearer.camera_hight_m is not a known field; did you mean 'camera_height_m'?"),
        (0.97, "wearer"),
    ],
)
def test_an_impossible_wearer_is_one_line(wearer: object, line: str) -> None:
    assert line in complaint(document(wearer=wearer))
