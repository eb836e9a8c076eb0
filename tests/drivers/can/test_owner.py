"""Whose program is at the other end of a loopback connection, by the kernel's own table."""

import os
import socket
from collections.abc import Iterator

import pytest

from drivers.can import owner
from drivers.can.bus import open_bus
from drivers.can.owner import check_server, is_ours
from drivers.can.settings import CanInterface, CanSettings
from drivers.protocols import DeviceError
from messages import UserError
from sim_rig.can.slcan_hub import SlcanHub

pytestmark = pytest.mark.skipif(not owner._TABLES[0].exists(), reason="the system has no /proc/net/tcp")

Connection = tuple[socket.socket, socket.socket, socket.socket]


@pytest.fixture
def connection() -> Iterator[Connection]:
    """A server, the end that a client has, and the server's end."""
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        socket.create_connection(server.getsockname()) as client,
        server.accept()[0] as accepted,
    ):
        yield server, client, accepted


def as_another_user(monkeypatch: pytest.MonkeyPatch) -> None:
    """To whom this process's sockets are another's: neither root's nor his own."""
    user = 64001 if os.geteuid() == 0 else os.geteuid() + 1
    monkeypatch.setattr(os, "geteuid", lambda: user)
    if os.getuid() == 0:
        monkeypatch.setattr(owner, "_ROOT", -1)


def test_both_ends_of_ones_own_connection_are_ones_own(connection: Connection) -> None:
    server, client, _ = connection
    check_server(client)
    assert is_ours(client.getsockname()[1], server.getsockname()[1])


def test_another_users_server_is_refused(connection: Connection, monkeypatch: pytest.MonkeyPatch) -> None:
    as_another_user(monkeypatch)
    with pytest.raises(UserError, match="held by another user's program"):
        check_server(connection[1])


def test_a_client_that_has_hung_up_is_nobodys(connection: Connection) -> None:
    server, client, _ = connection
    port = client.getsockname()[1]
    client.close()
    assert not is_ours(port, server.getsockname()[1])


def test_a_hub_hangs_up_on_another_user(monkeypatch: pytest.MonkeyPatch) -> None:
    hub = SlcanHub()
    address = ("127.0.0.1", int(hub.channel.rpartition(":")[2]))
    with socket.create_connection(address):
        hub.serve(1.0)
        assert hub.clients == 1
        as_another_user(monkeypatch)
        with socket.create_connection(address) as foreign:
            hub.serve(1.0)
            assert hub.clients == 1
            assert foreign.recv(1) == b""
    hub.close()


def test_a_bus_that_another_user_serves_is_one_clear_line(monkeypatch: pytest.MonkeyPatch) -> None:
    hub = SlcanHub()
    as_another_user(monkeypatch)
    with pytest.raises(DeviceError, match="held by another user's program") as refused:
        open_bus(CanSettings(interface=CanInterface.SLCAN, channel=hub.channel, settle_s=0.0))
    assert str(refused.value).startswith(f"CAN slcan:{hub.channel}: ")
    hub.close()
