"""What `gaiteyes view` says where there is nothing to see; what it shows stands in tests/cli/viewer."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from cli.view import view
from drivers.picture_socket import PictureServer
from drivers.zenoh import local_socket
from messages import UserError


@pytest.fixture(autouse=True)
def own_directory(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with tempfile.TemporaryDirectory(prefix="gaiteyes-") as folder:  # pytest's own paths are too long for sockets
        monkeypatch.setattr(local_socket, "SERVICE_DIRECTORY", Path(folder) / "none")
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        monkeypatch.setenv("HOME", folder)
        yield


def test_where_nothing_runs_the_next_step_is_told() -> None:
    with pytest.raises(UserError, match=r"no service runs here: start `gaiteyes run` or `gaiteyes demo`, or name a"):
        view()


def test_of_several_services_one_is_to_be_named() -> None:
    servers = [PictureServer(name) for name in ("unit-2", "unit-1")]
    with pytest.raises(UserError, match="2 services run on this machine: name one of unit-1, unit-2"):
        view()
    with pytest.raises(UserError, match=r"unit-3: no such recording.*; what runs here: unit-1, unit-2"):
        view("unit-3")
    for server in servers:
        server.close()


def test_what_is_no_recording_is_told(tmp_path: Path) -> None:
    (tmp_path / "walk.mcap").write_text("no recording")
    with pytest.raises(UserError, match="is no MCAP file"):
        view(str(tmp_path / "walk.mcap"))
