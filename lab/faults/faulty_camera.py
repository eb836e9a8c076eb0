"""The wearer's frames shown by the V4L2 node in real time, with faults of images, time stamps and system calls."""

import errno
import mmap
import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping

from drivers.camera import v4l2_abi as v4l2
from drivers.camera.frame_grid import GRID_NS
from drivers.camera.v4l2_device import IoctlArgument, LinuxKernel
from messages.arrays import GreyImage
from sim_rig.camera.rendered_frames import Rendered
from sim_rig.camera.v4l2_node import Fault, Mode, V4l2Node
from sim_rig.unit import HEIGHT_PX, WIDTH_PX
from sim_rig.wearer import SimulatedWearer

Pair = tuple[GreyImage, GreyImage]
ImageChange = Callable[[Pair], Pair]
"""From the left and right image (720, 1280) to what the camera shows; it leaves what it is given as it is."""

FRAME_RATE_HZ = 20
TRANSFER_S = 0.022
SLOTS = 40
_SILENCE_NS = 500_000_000  # without a frame for so long, the rendering process has stopped for want of room
_CATCHING_UP_NS = 1_000_000_000


class FaultyCamera(Mapping[int, Fault]):
    """A camera that shows the wearer's walk, frame k on the node exactly at the shutter's frame k.

    `image_changes` by name change images, `frame_faults` by name give the fault of a frame (by its number k), both in
    the order in which they came. A frame that the rendering process did not finish in time is lost, and counted in
    `rig_late`: that is the rig's own failure, unless the process starts or catches up after a camera that did not
    stream. It is its node's table of frame faults as well.
    """

    def __init__(self, wearer: SimulatedWearer) -> None:
        self._first_stamp_ns = wearer.shutter.stamp_ns(0)
        self._frames = wearer.frames_ahead(SLOTS)
        self._waiting: deque[Rendered] = deque()
        self._shown: Rendered | None = None
        self.image_changes: dict[str, ImageChange] = {}
        self.frame_faults: dict[str, Callable[[int], Fault | None]] = {}
        self.rig_late = 0
        self._exposed_ns = self._due_again_ns = 0
        self._began = False
        self.node = V4l2Node(
            self._pictures,
            LinuxKernel(),
            modes=[Mode("YUYV", 2 * WIDTH_PX, HEIGHT_PX)],
            rates_hz=(FRAME_RATE_HZ,),
            transfer_s=TRANSFER_S,
            faults=self,
            phase_ns=self._first_stamp_ns,
        )
        self.kernel = FaultyKernel(self.node)

    def close(self) -> None:
        """End the rendering process."""
        self._frames.close()

    def __getitem__(self, _frame: int) -> Fault:
        k, now_ns = self._now_exposed, self.node.monotonic_ns()
        if now_ns - self._exposed_ns > _SILENCE_NS:
            self._due_again_ns = now_ns + _CATCHING_UP_NS
        self._exposed_ns = now_ns
        faults = (of_frame(k) for of_frame in self.frame_faults.values())
        fault = next((found for found in faults if found is not None), None)
        if self._show(k):
            self._began = True
        elif fault is not Fault.UNPLUG:
            self.rig_late += fault is not Fault.LOST and self._began and now_ns > self._due_again_ns
            fault = Fault.LOST
        if fault is None:
            raise KeyError(k)
        return fault

    def __iter__(self) -> Iterator[int]:
        return iter(())

    def __len__(self) -> int:
        return 0

    @property
    def _now_exposed(self) -> int:
        return round((self.node.frame_start_ns - self._first_stamp_ns) / GRID_NS)

    def _show(self, k: int) -> bool:
        """Let go of the frames before `k` and hold frame `k`, if it has been rendered."""
        self._waiting.extend(self._frames.collect())
        if self._shown is not None and self._shown.k != k:
            self._frames.give_back(self._shown)
            self._shown = None
        while self._waiting and self._waiting[0].k < k:
            self._frames.give_back(self._waiting.popleft())
        if self._waiting and self._waiting[0].k == k:
            self._shown = self._waiting.popleft()
        return self._shown is not None

    def _pictures(self, _frame: int) -> Pair:
        if self._shown is None:
            raise RuntimeError("the node shows a frame that was never rendered")
        pair = self._frames.pictures(self._shown)
        for change in tuple(self.image_changes.values()):
            pair = change(pair)
        return pair


class FaultyKernel:
    """A Kernel (see `drivers.camera.v4l2_device`) before the node's own: `dequeue_error` fails every VIDIOC_DQBUF
    with this errno, `silent` makes a camera that streams without ever filling a buffer.
    """

    def __init__(self, node: V4l2Node) -> None:
        self._node = node
        self.dequeue_error = 0
        self.silent = False

    def monotonic_ns(self) -> int:
        """Return the time."""
        return self._node.monotonic_ns()

    def sleep(self, duration_s: float) -> None:
        """Wait."""
        self._node.sleep(duration_s)

    def open(self, path: str) -> int:
        """Open the node."""
        return self._node.open(path)

    def close(self, fd: int) -> None:
        """Close the node."""
        self._node.close(fd)

    def mmap(self, fd: int, length: int, offset: int) -> mmap.mmap:
        """Map a buffer."""
        return self._node.mmap(fd, length, offset)

    def poll(self, fd: int, timeout_s: float) -> int:
        """Wait for a frame."""
        if self.silent:
            self._node.sleep(timeout_s)
            return 0
        return self._node.poll(fd, timeout_s)

    def ioctl(self, fd: int, request: int, argument: IoctlArgument) -> None:
        """Answer a request, or fail it."""
        if request == v4l2.VIDIOC_DQBUF and self.dequeue_error:
            raise OSError(self.dequeue_error, os.strerror(self.dequeue_error))
        if request == v4l2.VIDIOC_DQBUF and self.silent:
            raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
        self._node.ioctl(fd, request, argument)
