"""Where service and subscribers meet: found by the device's name, and only where nobody else may put a socket."""

import os
import socket
from pathlib import Path

import pytest

from drivers.zenoh import local_socket
from drivers.zenoh.local_socket import (
    LONGEST_PATH_BYTES,
    check_private,
    service_endpoint,
    socket_path,
    subscriber_endpoint,
)
from drivers.zenoh.settings import SOCKET, is_secure
from messages import UserError


@pytest.fixture
def session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's session with a directory of its own, on a host without an installed service."""
    folder = tmp_path / "session"
    folder.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    monkeypatch.setattr(local_socket, "SERVICE_DIRECTORY", tmp_path / "installed")
    return folder


@pytest.fixture
def nearby(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Come back at the end from where `put_socket` has gone."""
    monkeypatch.chdir(tmp_path)


def put_socket(path: Path) -> None:
    """Make a socket in its own directory: the whole path may be too long for one."""
    with socket.socket(socket.AF_UNIX) as made:
        os.chdir(path.parent)
        made.bind(path.name)


def test_what_a_person_starts_is_private_and_found_again(session: Path, nearby: None) -> None:
    endpoint = service_endpoint("unit-1")
    assert endpoint == f"{SOCKET}{session}/gaiteyes/unit-1.sock"
    assert (session / "gaiteyes").stat().st_mode & 0o777 == 0o700
    put_socket(session / "gaiteyes" / "unit-1.sock")
    assert subscriber_endpoint("unit-1") == endpoint
    with pytest.raises(UserError, match="nobody publishes as 'unit-2' on this machine"):
        subscriber_endpoint("unit-2")


def test_an_installed_service_comes_first(session: Path, tmp_path: Path, nearby: None) -> None:
    put_socket(Path(service_endpoint("unit-1").removeprefix(SOCKET)))
    installed = tmp_path / "installed"
    installed.mkdir(mode=0o750)
    assert service_endpoint("unit-1") == f"{SOCKET}{installed}/unit-1.sock"
    assert subscriber_endpoint("unit-1").startswith(f"{SOCKET}{session}"), "its socket is not there yet"
    put_socket(installed / "unit-1.sock")
    assert subscriber_endpoint("unit-1") == f"{SOCKET}{installed}/unit-1.sock"


def test_a_file_that_is_no_socket_is_not_found(session: Path) -> None:
    Path(service_endpoint("unit-1").removeprefix(SOCKET)).write_text("")
    with pytest.raises(UserError, match="nobody publishes"):
        subscriber_endpoint("unit-1")


@pytest.mark.parametrize("to_listen", [True, False])
@pytest.mark.parametrize("mode", [0o777, 0o1777, 0o770, 0o1770, 0o702])
def test_a_directory_that_others_may_write_is_refused(tmp_path: Path, mode: int, to_listen: bool) -> None:
    tmp_path.chmod(mode)
    with pytest.raises(UserError, match="others may write") as refused:
        check_private(tmp_path / "unit-1.sock", to_listen=to_listen)
    assert "\n" not in str(refused.value)
    tmp_path.chmod(0o755)
    check_private(tmp_path / "unit-1.sock", to_listen=to_listen)


def test_on_the_way_a_sticky_directory_is_no_harm_and_any_other_that_others_write_is(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir(mode=0o700)
    tmp_path.chmod(0o1777)
    check_private(inner / "unit-1.sock", to_listen=False)
    tmp_path.chmod(0o777)
    with pytest.raises(UserError, match=f"others may write {tmp_path}"):
        check_private(inner / "unit-1.sock", to_listen=False)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a directory away")
def test_another_users_directory_is_for_listening_to_only_where_he_could_not_put_it_himself(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir(mode=0o755)
    os.chown(inner, 64001, 64001)
    check_private(inner / "unit-1.sock", to_listen=False)
    with pytest.raises(UserError, match="others may write"):
        check_private(inner / "unit-1.sock", to_listen=True)
    tmp_path.chmod(0o1777)
    with pytest.raises(UserError, match="others may write"):
        check_private(inner / "unit-1.sock", to_listen=False)


def test_a_directory_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=f"{tmp_path}/missing: No such file or directory"):
        check_private(tmp_path / "missing" / "unit-1.sock", to_listen=True)


def test_a_path_that_is_too_long_is_refused() -> None:
    longest = "/" + (LONGEST_PATH_BYTES - 1) * "a"
    assert socket_path(SOCKET + longest) == Path(longest)
    with pytest.raises(UserError, match="at most 107 bytes"):
        socket_path(SOCKET + longest + "a")


@pytest.mark.parametrize(
    ("endpoint", "secure"),
    [(f"{SOCKET}/a", True), ("tls/host:1", True), ("tcp/127.0.0.1:1", False), ("quic/host:1", False), ("", False)],
)
def test_a_socket_and_tls_are_secure_and_nothing_else(endpoint: str, secure: bool) -> None:
    assert is_secure(endpoint) is secure
