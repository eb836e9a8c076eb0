"""The daemon's configuration: one TOML file, checked on load, every value with its default and its range."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import msgspec

from daemon.setpoints import SetpointSettings
from drivers.can.settings import CanSettings
from drivers.zenoh.settings import ZenohSettings
from messages import UserError
from messages.checked import HEXADECIMAL, checked, is_hexadecimal
from messages.text_files import parse_toml, read_text
from perception.ground.foothold import FootholdSettings


class ImuSettings(msgspec.Struct, frozen=True, kw_only=True):
    """The MPU-6050, or a relative, at `address` of /dev/i2c-`bus`.

    `data_ready` is the GPIO line on which its INT pin hangs, as CHIP:LINE ("/dev/gpiochip0:17"); without it the chip
    is polled.
    """

    bus: Annotated[int, msgspec.Meta(ge=0, le=255)] = 1
    address: Annotated[int, msgspec.Meta(ge=0x68, le=0x69, extra=HEXADECIMAL)] = 0x68
    data_ready: Annotated[str, msgspec.Meta(pattern="^(/[^:]+:[0-9]{1,3})?$")] = ""


class CameraSettings(msgspec.Struct, frozen=True, kw_only=True):
    """The camera: `device` delivers both eyes side by side, as a ZED does, or depth; the calibration tells which, and
    the size of one eye. Or `left` and `right` are two cameras, used while they expose within `max_skew_s` of each other
    (see drivers.camera.pair for what that costs). A path of /dev/v4l/by-id or by-path outlives unplugging.

    `rate_hz` is preferred among the camera's rates. `exposure_s` and `gain_percent` fix both eyes of a ZED; without
    them its automatic is left as it is.
    """

    device: str = "/dev/video0"
    left: str | None = None
    right: str | None = None
    max_skew_s: Annotated[float, msgspec.Meta(ge=0.0001, le=0.025)] = 0.001
    rate_hz: Annotated[int, msgspec.Meta(ge=20, le=120)] = 60
    exposure_s: Annotated[float, msgspec.Meta(gt=0.0, le=0.05)] | None = None
    gain_percent: Annotated[float, msgspec.Meta(ge=0.0, le=100.0)] | None = None

    def __post_init__(self) -> None:
        """Refuse what contradicts itself."""
        if (self.left is None) != (self.right is None):
            raise ValueError("left and right belong together: each eye needs its camera")
        if self.left is not None and self.left == self.right:
            raise ValueError(f"left and right are both {self.left}: each eye needs its own camera")
        if (self.exposure_s is None) != (self.gain_percent is None):
            raise ValueError("exposure_s and gain_percent belong together: fixing one ends the automatic of both")
        if self.left is not None and self.exposure_s is not None:
            raise ValueError("exposure_s and gain_percent are a ZED's, not those of the two cameras left and right")


class RealtimeSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Whether to ask for real-time priorities and for memory that is never paged out."""

    priorities: bool = True
    lock_memory: bool = True


class ViewSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Whether `gaiteyes view` on this machine may have `pictures` of the left eye; estimates it may always have."""

    pictures: bool = True


class Configuration(msgspec.Struct, frozen=True, kw_only=True):
    """All settings. `device` is the name under which the unit publishes; `calibration` the path of its file.

    `learnt` is the path of the file that keeps what the unit learns of its sensors (`daemon.state_file`).
    """

    device: Annotated[str, msgspec.Meta(pattern="^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")] = "gaiteyes"
    calibration: str = "calibration.yaml"
    learnt: Annotated[str, msgspec.Meta(min_length=1)] = "learnt.json"
    imu: ImuSettings = ImuSettings()
    camera: CameraSettings = CameraSettings()
    foothold: FootholdSettings = FootholdSettings()
    zenoh: ZenohSettings = ZenohSettings()
    can: CanSettings = CanSettings()
    setpoint: SetpointSettings = SetpointSettings()
    realtime: RealtimeSettings = RealtimeSettings()
    view: ViewSettings = ViewSettings()


def load_configuration(path: Path) -> Configuration:
    """Return the configuration that the file holds; raises UserError, one line with file, field and allowed range."""
    if not path.exists():
        raise UserError(f"{path}: No such file or directory; `gaiteyes init` finds the devices and writes one")
    return parse_configuration(read_text(path), str(path))


def parse_configuration(text: str, where: str) -> Configuration:
    """Return the configuration that `text` holds, for instance the one embedded in a recording."""
    return checked(parse_toml(text, where), Configuration, where)


def format_configuration(configuration: Configuration) -> str:
    """Return the text of a file that holds `configuration`, defaults included."""
    return _format(configuration, lambda _field: True)


def format_choices(configuration: Configuration) -> str:
    """Return the text of a file with what a person has to choose; what it leaves out has its default.

    Raises ValueError if `configuration` differs from the defaults in anything else.
    """
    camera = _EYES_APART if configuration.camera.left is not None else _ONE_CAMERA
    text = _format(configuration, lambda field: field in _CHOICES + camera)
    if parse_configuration(text, "choices") != configuration:
        raise ValueError(f"a configuration of more than {', '.join(_CHOICES + camera)}")
    return text


_CHOICES = ("device", "calibration", "imu.bus", "imu.address", "imu.data_ready", "can.interface", "can.channel")
_ONE_CAMERA, _EYES_APART = ("camera.device",), ("camera.left", "camera.right")


def _format(configuration: Configuration, is_shown: Callable[[str], bool]) -> str:
    tables: list[str] = []
    top: list[str] = []
    for name, value in msgspec.to_builtins(configuration).items():
        if isinstance(value, dict):
            shown = [key for key, item in value.items() if item is not None and is_shown(f"{name}.{key}")]
            settings = [f"{key} = {_literal(value[key], f'{name}.{key}')}" for key in shown]
            tables += ["", f"[{name}]", *settings] if settings else []
        elif is_shown(name):
            top.append(f"{name} = {_literal(value, name)}")
    return "\n".join(top + tables) + "\n"


def _literal(value: object, field: str) -> str:
    if isinstance(value, int) and is_hexadecimal(Configuration, field):
        return f"{value:#x}"
    # JSON's literals for strings, numbers and booleans are TOML's too
    return msgspec.json.encode(value).decode()
