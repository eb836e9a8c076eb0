"""A wrong setting is one line that names file, field and allowed range."""

from pathlib import Path

import msgspec
import pytest

from daemon.config import CameraSettings, Configuration, format_configuration, load_configuration, parse_configuration
from drivers.can.settings import CanInterface
from messages import UserError
from perception.ground.foothold import FootholdSettings


def test_defaults_survive_writing_and_reading() -> None:
    configuration = Configuration(
        device="left-leg",
        camera=CameraSettings(left="/dev/video0", right="/dev/video2"),
        foothold=FootholdSettings(ahead_m=0.8),
    )
    assert parse_configuration(format_configuration(configuration), "x") == configuration


def test_an_empty_file_is_the_defaults(tmp_path: Path) -> None:
    path = tmp_path / "gaiteyes.toml"
    path.write_text("")
    assert load_configuration(path) == Configuration()


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("[foothold]\nahead_m = 9.0", "f.toml: foothold.ahead_m is 9.0, allowed a number from 0.2 to 4"),
        ("[imu]\naddress = 5", "f.toml: imu.address is 0x5, allowed a whole number from 0x68 to 0x69"),
        (
            "[imu]\ndata_ready = 'gpiochip0 17'",
            "f.toml: imu.data_ready is 'gpiochip0 17', allowed text like ^(/[^:]+:[0-9]{1,3})?$",
        ),
        ("[imu]\nbus = 'one'", "f.toml: imu.bus is 'one', allowed a whole number from 0 to 255"),
        (
            "[can]\ninterface = 'lin'",
            "f.toml: can.interface is 'lin', allowed one of " + ", ".join(i.value for i in CanInterface),
        ),
        ("[foothold]\nahed_m = 0.7", "f.toml: foothold.ahed_m is not a known field; did you mean 'ahead_m'?"),
        ("[fothold]\nahead_m = 0.7", "f.toml: fothold is not a known field; did you mean 'foothold'?"),
        ("device = 'a b'", "f.toml: device is 'a b', allowed text like ^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"),
        ("[camera]\nmax_skew_s = 1", "f.toml: camera.max_skew_s is 1, allowed a number from 0.0001 to 0.025"),
        (
            "[camera]\nexposure_s = 0.2\ngain_percent = 9",
            "f.toml: camera.exposure_s is 0.2, allowed a number above 0 to 0.05",
        ),
        ("[camera]\nleft = '/dev/video0'", "f.toml: camera: left and right belong together: each eye needs its camera"),
        (
            "[camera]\nleft = '/dev/video0'\nright = '/dev/video0'",
            "f.toml: camera: left and right are both /dev/video0: each eye needs its own camera",
        ),
        (
            "[camera]\nexposure_s = 0.004",
            "f.toml: camera: exposure_s and gain_percent belong together: fixing one ends the automatic of both",
        ),
        (
            "[camera]\nleft = 'a'\nright = 'b'\nexposure_s = 0.004\ngain_percent = 9",
            "f.toml: camera: exposure_s and gain_percent are a ZED's, not those of the two cameras left and right",
        ),
    ],
)
def test_a_mistake_is_one_line_with_field_and_range(text: str, line: str) -> None:
    with pytest.raises(UserError) as refused:
        parse_configuration(text, "f.toml")
    assert str(refused.value) == line


def test_no_toml_and_no_file_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"^f\.toml: not TOML: .*line 1"):
        parse_configuration("[[[", "f.toml")
    with pytest.raises(UserError, match=r"nowhere\.toml: No such file or directory; `gaiteyes init` finds the devices"):
        load_configuration(tmp_path / "nowhere.toml")


def test_every_setting_has_a_default() -> None:
    assert msgspec.convert({}, Configuration) == Configuration()
