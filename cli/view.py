"""`gaiteyes view`: what the eyes see, in a browser of this machine."""

from pathlib import Path
from typing import Annotated

import typer


def view(
    source: Annotated[
        str | None,
        typer.Argument(
            help="A recording, a folder in the EuRoC/ASL layout, or the device's name; by default what runs here."
        ),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the loopback interface; 0 takes any.")] = 8642,
) -> None:
    """Show picture, ground, attitude, latencies and health of SOURCE in a browser of this machine.

    Nothing leaves the machine: the page is served on 127.0.0.1, to whoever knows the address that is printed.
    """
    import cv2

    from cli.console import console
    from cli.viewer.board import Board
    from cli.viewer.server import ViewServer
    from drivers.picture_socket import devices_here
    from messages import UserError

    cv2.setNumThreads(1)
    path = None if source is None else Path(source)
    if path is not None and path.exists():
        from cli.viewer.played import Player
        from daemon.replay_source import open_source

        board = Board(str(path))
        player = Player(open_source(path, None), board)
        with ViewServer(board, port, player.command) as server:
            console.print(f"{path} in a browser of this machine: {server.url}", highlight=False, soft_wrap=True)
            server.wait_for_a_browser()
            player.play()
        return
    from cli.viewer.live import follow_device

    here = devices_here()
    if source is None and len(here) > 1:
        raise UserError(f"{len(here)} services run on this machine: name one of {', '.join(here)}")
    if source is None and not here:
        raise UserError("no service runs here: start `gaiteyes run` or `gaiteyes demo`, or name a recording")
    device = here[0] if source is None else source
    if device not in here:
        raise UserError(
            f"{source}: no such recording, and no service of this name runs on this machine"
            + (f"; what runs here: {', '.join(here)}" if here else "")
        )
    board = Board(device)
    with ViewServer(board, port, lambda _said: None) as server:
        console.print(f"'{device}' in a browser of this machine: {server.url}", highlight=False, soft_wrap=True)
        follow_device(device, board)
