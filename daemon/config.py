"""The daemon's configuration: one TOML file, checked on load, every value with its default and its range."""

from pathlib import Path
from typing import Annotated

import msgspec
import tomli

from daemon.publish_zenoh import ZenohSettings
from drivers.can_bus import CanSettings
from messages import UserError
from messages.checked import checked
from perception.foothold import FootholdSettings


class ImuConfig(msgspec.Struct, frozen=True, kw_only=True):
    """The MPU-6050 at `address` of /dev/i2c-`bus`."""

    bus: Annotated[int, msgspec.Meta(ge=0, le=255)] = 1
    address: Annotated[int, msgspec.Meta(ge=0x68, le=0x69)] = 0x68


class CameraConfig(msgspec.Struct, frozen=True, kw_only=True):
    """A camera that delivers both eyes side by side, as a ZED does; the size of one eye is the calibration's."""

    device: str = "/dev/video0"
    rate_hz: Annotated[int, msgspec.Meta(ge=20, le=120)] = 60


class Configuration(msgspec.Struct, frozen=True, kw_only=True):
    """All settings. `device` is the name under which the unit publishes; `calibration` the path of its file."""

    device: Annotated[str, msgspec.Meta(pattern="^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")] = "gaiteyes"
    calibration: str = "calibration.yaml"
    imu: ImuConfig = ImuConfig()
    camera: CameraConfig = CameraConfig()
    foothold: FootholdSettings = FootholdSettings()
    zenoh: ZenohSettings = ZenohSettings()
    can: CanSettings = CanSettings()


def load_configuration(path: Path) -> Configuration:
    """Return the configuration that the file holds; raises UserError, one line with file, field and allowed range."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: not UTF-8 text (byte {error.start})") from error
    return parse_configuration(text, str(path))


def parse_configuration(text: str, where: str) -> Configuration:
    """Return the configuration that `text` holds, for instance the one embedded in a recording."""
    try:
        document = tomli.loads(text)
    except tomli.TOMLDecodeError as error:
        raise UserError(f"{where}: not TOML: {error}") from error
    return checked(document, Configuration, where)


def format_configuration(configuration: Configuration) -> str:
    """Return the text of a file that holds `configuration`, defaults included."""
    tables: list[str] = []
    top: list[str] = []
    for name, value in msgspec.to_builtins(configuration).items():
        if isinstance(value, dict):
            tables += ["", f"[{name}]", *(f"{key} = {_literal(item)}" for key, item in value.items())]
        else:
            top.append(f"{name} = {_literal(value)}")
    return "\n".join(top + tables) + "\n"


def _literal(value: object) -> str:
    # JSON's literals for strings, numbers and booleans are TOML's too
    return msgspec.json.encode(value).decode()
