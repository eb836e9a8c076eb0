"""Several V4L2 nodes behind one kernel."""

import errno
import mmap
from collections.abc import Sequence

from drivers.camera.v4l2_device import IoctlArgument
from sim_rig.camera.v4l2_buffers import os_error
from sim_rig.camera.v4l2_node import V4l2Node


class V4l2Machine:
    """A Kernel (see `drivers.camera.v4l2_device`) with these nodes, all on the clock of the first."""

    def __init__(self, nodes: Sequence[V4l2Node]) -> None:
        self._nodes = nodes
        self._open: dict[int, tuple[V4l2Node, int]] = {}
        self._latest_descriptor = 2

    def monotonic_ns(self) -> int:
        """Return the time."""
        return self._nodes[0].monotonic_ns()

    def sleep(self, duration_s: float) -> None:
        """Let time pass."""
        self._nodes[0].sleep(duration_s)

    def open(self, path: str) -> int:
        """Open the node of this name."""
        for node in self._nodes:
            if path in (node.path, node.link):
                descriptor = node.open(path)
                self._latest_descriptor += 1
                self._open[self._latest_descriptor] = node, descriptor
                return self._latest_descriptor
        raise os_error(errno.ENOENT)

    def ioctl(self, fd: int, request: int, argument: IoctlArgument) -> None:
        """Answer a request to the node that is open as `fd`."""
        node, descriptor = self._open[fd]
        node.ioctl(descriptor, request, argument)

    def mmap(self, fd: int, length: int, offset: int) -> mmap.mmap:
        """Map a buffer."""
        node, descriptor = self._open[fd]
        return node.mmap(descriptor, length, offset)

    def poll(self, fd: int, timeout_s: float) -> int:
        """Wait for a frame of the node that is open as `fd`."""
        node, descriptor = self._open[fd]
        return node.poll(descriptor, timeout_s)

    def close(self, fd: int) -> None:
        """Close a descriptor."""
        node, descriptor = self._open.pop(fd)
        node.close(descriptor)
