"""The unit file, what it is allowed, and what `make install` puts where."""

import shutil
import subprocess
from pathlib import Path

import pytest

from daemon.config import Configuration, load_configuration
from daemon.realtime import FIFO_PRIORITIES
from drivers.can.settings import CanInterface, CanSettings

PROJECT = Path(__file__).parents[2]
SYSTEMD = PROJECT / "systemd"
UNIT = SYSTEMD / "gaiteyes.service"


def systemd_analyze(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not installed")
    return subprocess.run(
        ["systemd-analyze", *map(str, arguments)], capture_output=True, text=True, timeout=60, check=False
    )


def make(*arguments: str) -> None:
    done = subprocess.run(["make", "-s", "-C", PROJECT, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def settings(unit: Path = UNIT) -> dict[str, list[str]]:
    """Return all values of each setting, in order."""
    found: dict[str, list[str]] = {}
    for line in unit.read_text(encoding="utf-8").splitlines():
        key, equals, value = line.partition("=")
        if equals and not line.startswith("#"):
            found.setdefault(key, []).append(value)
    return found


def test_the_unit_is_hardened() -> None:
    done = systemd_analyze("security", "--offline=true", "--threshold=25", UNIT)
    assert done.returncode == 0, done.stdout[-400:]


def test_the_unit_allows_what_the_daemon_needs() -> None:
    unit = settings()
    devices = {value.split()[0] for value in unit["DeviceAllow"]}
    assert devices == {f"char-{name}" for name in ("i2c", "gpiochip", "video4linux", "ttyACM", "ttyUSB")}
    families = unit["RestrictAddressFamilies"][0].split()
    assert {"AF_UNIX", "AF_INET", "AF_CAN"} <= set(families)
    assert "localhost" in unit["IPAddressAllow"]
    assert int(unit["LimitRTPRIO"][0]) >= max(FIFO_PRIORITIES.values())
    assert unit["LimitMEMLOCK"] == ["infinity"]
    assert not {"RestrictRealtime", "CPUSchedulingPolicy", "PrivateDevices"} & set(unit)


def test_every_group_of_the_unit_is_made_and_joined() -> None:
    lines = [line.split() for line in (SYSTEMD / "gaiteyes.sysusers").read_text(encoding="utf-8").splitlines()]
    joined = {line[2] for line in lines if line and line[0] == "m"}
    assert joined == set(settings()["SupplementaryGroups"][0].split())
    rules = (SYSTEMD / "70-gaiteyes.rules").read_text(encoding="utf-8")
    assert all(f'GROUP="{group}"' in rules for group in ("i2c", "gpio", "video"))


def test_the_default_configuration_is_valid_and_on_real_devices() -> None:
    configuration = load_configuration(SYSTEMD / "gaiteyes.toml")
    on_can = CanSettings(interface=CanInterface.SOCKETCAN, channel="can0")
    assert configuration == Configuration(can=on_can, learnt="/var/lib/gaiteyes/learnt.json")


@pytest.mark.parametrize("prefix", ["/usr", "/usr/local"])
def test_what_the_unit_names_is_installed_and_uninstall_leaves_the_configuration(tmp_path: Path, prefix: str) -> None:
    where = f"DESTDIR={tmp_path}", f"PREFIX={prefix}"
    make("install-files", *where)
    unit = tmp_path / prefix[1:] / "lib/systemd/system/gaiteyes.service"
    named = settings(unit)
    command, _, _, configuration = named["ExecStart"][0].split()
    paths = [command, configuration, named["Documentation"][0].removeprefix("file:")]
    assert all((tmp_path / path[1:]).is_file() for path in paths)
    assert command == f"{prefix}/bin/gaiteyes"
    wrapper = (tmp_path / command[1:]).read_text(encoding="ascii")
    assert f"exec {prefix}/lib/gaiteyes/bin/python " in wrapper

    here = tmp_path / "gaiteyes.service"
    here.write_text(unit.read_text().replace(f"={prefix}/", f"={tmp_path}{prefix}/"), encoding="utf-8")
    verified = systemd_analyze("verify", here)
    assert (verified.returncode, verified.stderr) == (0, "")
    here.unlink()

    mine = tmp_path / "etc/gaiteyes/gaiteyes.toml"
    mine.write_text("device = 'mine'\n", encoding="utf-8")
    make("install-files", *where)
    assert mine.read_text(encoding="utf-8") == "device = 'mine'\n"
    make("uninstall", *where)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [mine]
