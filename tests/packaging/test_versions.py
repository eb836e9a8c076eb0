"""An upgrade reads what earlier versions wrote; after a roll-back what a later one wrote is refused, and not lost.

`earlier/` holds files as an earlier version wrote them. They are never written anew: when a file of today can no longer
stand for one of them, a folder is added.
"""

import hashlib
import logging
import shutil
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import msgspec
import pytest

from calib.files import format_calibration, load_calibration, parse_calibration, save_calibration
from calib.seal import sealed
from daemon.config import format_configuration, load_configuration, parse_configuration
from daemon.state_file import FORMAT, StateKeeper, read_state, write_state
from drivers.can.settings import CanInterface
from messages import UserError

EARLIER = Path(__file__).with_name("earlier")
CALIBRATION_ID, LEARNT_ID = "92ad37d8", "e020fcf8"
"""As that version told them: recordings and states name them."""
NOW = datetime(2026, 11, 22, tzinfo=timezone.utc)


def test_an_earlier_configuration_means_the_same() -> None:
    configuration = load_configuration(EARLIER / "gaiteyes.toml")
    assert (configuration.device, configuration.imu.bus, configuration.imu.address) == ("unit-1", 3, 0x69)
    assert configuration.can.interface is CanInterface.SOCKETCAN
    assert parse_configuration(format_configuration(configuration), "again") == configuration


def test_an_earlier_calibration_keeps_its_id_and_may_be_written_anew(tmp_path: Path) -> None:
    calibration = load_calibration(EARLIER / "calibration.yaml")
    assert calibration.id == CALIBRATION_ID
    assert calibration.residual.baseline_std > 0.0  # a term that it does not state
    save_calibration(tmp_path / "again.yaml", calibration)
    assert load_calibration(tmp_path / "again.yaml") == calibration


def test_what_was_learnt_earlier_is_still_known(tmp_path: Path) -> None:
    calibration = load_calibration(EARLIER / "calibration.yaml")
    path = tmp_path / "learnt.json"
    shutil.copyfile(EARLIER / "learnt.json", path)
    learnt = StateKeeper(path, calibration).load()
    assert learnt is not None
    assert (learnt.id, learnt.used_s) == (LEARNT_ID, 120.0)
    write_state(path, learnt, NOW)
    state = read_state(path, calibration)
    assert state is not None
    assert state.learnt == learnt


def test_a_later_configuration_is_refused_in_one_line_that_names_what_is_new() -> None:
    text = (EARLIER / "gaiteyes.toml").read_text(encoding="utf-8")
    with pytest.raises(UserError, match=r"^f\.toml: imu\.magnetometer is not a known field; allowed: bus, address"):
        parse_configuration(text.replace("[imu]", "[imu]\nmagnetometer = true"), "f.toml")
    with pytest.raises(UserError, match=r"^f\.toml: radar is not a known field"):
        parse_configuration(text + "\n[radar]\non = true\n", "f.toml")


def test_a_later_calibration_is_refused_in_one_line_and_left_as_it_is(tmp_path: Path) -> None:
    calibration = load_calibration(EARLIER / "calibration.yaml")
    later = sealed(format_calibration(calibration) + "magnetometer:\n  bias: [0.0, 0.0, 0.0]\n")
    path = tmp_path / "calibration.yaml"
    path.write_text(later, encoding="utf-8")
    with pytest.raises(UserError, match=r"calibration\.yaml: magnetometer is not a known field"):
        load_calibration(path)
    assert path.read_text(encoding="utf-8") == later
    with pytest.raises(UserError, match=r"recorded: residual\.drift is not a known field"):
        parse_calibration(format_calibration(calibration).replace("{specific", "{drift: 0.1, specific"), "recorded")


def test_a_later_state_is_set_aside_and_found_again(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    calibration = load_calibration(EARLIER / "calibration.yaml")
    path = tmp_path / "learnt.json"
    document: dict[str, Any] = msgspec.json.decode((EARLIER / "learnt.json").read_bytes().split(b"\n")[0])
    body = msgspec.json.encode(document | {"format": FORMAT + 1, "more": [1, 2, 3]})
    later = body + b"\n" + hashlib.sha256(body).hexdigest().encode() + b"\n"
    path.write_bytes(later)
    keeper = StateKeeper(path, calibration)
    with caplog.at_level(logging.WARNING):
        assert keeper.load() is None
    assert caplog.messages == [
        f"{path}: its format is '{FORMAT + 1}', allowed '{FORMAT}'; set aside as learnt.json.other-format, "
        "the unit learns anew"
    ]
    before = read_state(EARLIER / "learnt.json", calibration)
    assert before is not None
    keeper.keep(before.learnt)  # what this version learns has a file of its own
    assert read_state(path, calibration) is not None
    assert path.with_name("learnt.json.other-format").read_bytes() == later
