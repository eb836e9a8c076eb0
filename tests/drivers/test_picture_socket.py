"""Packets arrive whole or not at all, and no reader can hold up or harm who sends them."""

import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers import picture_socket
from drivers.picture_socket import LONGEST_PACKET_BYTES, MOST_READERS, PictureReader, PictureServer, devices_here
from drivers.protocols import DeviceError
from messages import UserError

GREETING = b"greeting"
PATIENCE_S = 20.0


@pytest.fixture(autouse=True)
def directory(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="gaiteyes-") as folder:  # pytest's own paths are too long for sockets
        monkeypatch.setattr(picture_socket, "service_directory", lambda: Path(folder))
        monkeypatch.setattr(picture_socket, "service_directories", lambda: [Path(folder)])
        yield Path(folder)


@pytest.fixture
def server() -> Iterator[PictureServer]:
    server = PictureServer("bench")
    yield server
    server.close()


def test_a_reader_is_greeted_and_gets_each_packet_whole(server: PictureServer) -> None:
    watched = [server.is_watched]
    reader = PictureReader("bench")
    server.welcome(GREETING)
    watched.append(server.is_watched)
    assert watched == [False, True]
    packets = [bytes([k]) * length for k, length in enumerate((1, 50_000, LONGEST_PACKET_BYTES))]
    for packet in packets:
        server.send(packet)
        if packet is packets[0]:
            assert reader.receive(PATIENCE_S) == GREETING
        assert reader.receive(PATIENCE_S) == packet
    assert server.dropped == 0
    assert reader.receive(0.0) is None
    reader.close()


def test_who_does_not_read_loses_packets_and_holds_up_nobody(server: PictureServer) -> None:
    idle, reader = PictureReader("bench"), PictureReader("bench")
    server.welcome(GREETING)
    assert reader.receive(PATIENCE_S) == GREETING
    for k in range(20):
        server.send(bytes([k]) * 100_000)
        got = reader.receive(PATIENCE_S)
        assert got is not None
        assert got[0] == k
    assert 10 < server.dropped <= 20
    idle.close()
    reader.close()


def test_what_is_too_long_is_dropped(server: PictureServer) -> None:
    reader = PictureReader("bench")
    server.welcome(GREETING)
    server.send(bytes(LONGEST_PACKET_BYTES + 1))
    assert server.dropped == 1
    assert reader.receive(PATIENCE_S) == GREETING
    assert reader.receive(0.0) is None
    reader.close()


def test_who_has_gone_is_forgotten_and_who_is_one_too_many_is_hung_up_on(server: PictureServer) -> None:
    readers = [PictureReader("bench") for _ in range(MOST_READERS)]
    server.welcome(GREETING)
    late = PictureReader("bench")
    server.welcome(GREETING)
    with pytest.raises(EOFError):
        late.receive(PATIENCE_S)
    late.close()
    for reader in readers:
        reader.close()
    server.send(b"to nobody")
    assert not server.is_watched


def test_the_end_of_the_service_is_told(server: PictureServer) -> None:
    reader = PictureReader("bench")
    server.welcome(GREETING)
    server.close()
    assert reader.receive(PATIENCE_S) == GREETING
    with pytest.raises(EOFError):
        reader.receive(PATIENCE_S)
    reader.close()
    with pytest.raises(UserError, match="'bench' does not run"):
        PictureReader("bench")


def test_the_place_of_a_running_service_is_not_taken_that_of_a_killed_one_is(directory: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as killed:
        killed.bind(str(directory / "bench.view"))
    assert devices_here() == []
    first = PictureServer("bench")
    assert devices_here() == ["bench"]
    with pytest.raises(DeviceError, match=r"bench\.view: no pictures for `gaiteyes view`"):
        PictureServer("bench")
    first.close()
    assert list(directory.iterdir()) == []


def test_where_others_may_write_nothing_is_served(directory: Path) -> None:
    directory.chmod(0o777)
    with pytest.raises(UserError, match="others may write"):
        PictureServer("bench")
