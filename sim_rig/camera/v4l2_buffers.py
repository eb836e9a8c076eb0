"""The frame buffers of a V4L2 node: who owns them, which the driver may fill, which wait to be taken.

They behave as videobuf2 does, errno for errno, and are stricter where hardware is merely unpredictable: a buffer given
back is overwritten at once, and a mapping left open keeps the node busy.
"""

import ctypes
import enum
import errno
import mmap
import os
from collections import deque
from collections.abc import Set

import numpy as np

from drivers.camera import v4l2_abi as v4l2

_REWRITTEN = 0xA5


class _State(enum.Enum):
    DEQUEUED = enum.auto()
    QUEUED = enum.auto()
    DONE = enum.auto()


class Slot:
    """One frame buffer: its memory, and what the node tells about the frame in it."""

    def __init__(self, index: int, length: int) -> None:
        self.memory = mmap.mmap(-1, length)
        self.state = _State.DEQUEUED
        self.info = v4l2.Buffer(
            index=index, type=v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE, memory=v4l2.V4L2_MEMORY_MMAP, length=length
        )
        self.info.m.offset = index * length


class Buffers:
    """All buffers of one node, which grants `most` of them at most."""

    def __init__(self, most: int) -> None:
        self._most = most
        self.release()

    def release(self) -> None:
        """Forget all buffers and their owner; streaming ends."""
        self.streaming = False
        self.owner: int | None = None
        self._slots: list[Slot] = []
        self._queued: deque[Slot] = deque()
        self._done: deque[Slot] = deque()

    def release_if_abandoned(self, descriptors: Set[int]) -> None:
        """Release the buffers once their owner has closed its descriptor, none of `descriptors`, and every mapping."""
        if self.owner not in descriptors and all(slot.memory.closed for slot in self._slots):
            self.release()

    # What the owner asks for.

    def request(self, fd: int, request: v4l2.RequestBuffers, frame_bytes: int) -> None:
        """Answer VIDIOC_REQBUFS."""
        check(request.type == v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE and request.memory == v4l2.V4L2_MEMORY_MMAP)
        self.check_free()
        request.count = min(request.count, self._most)
        length = -(-frame_bytes // mmap.PAGESIZE) * mmap.PAGESIZE
        self.owner = fd
        self._slots = [Slot(index, length) for index in range(request.count)]

    def describe(self, fd: int, buffer: v4l2.Buffer) -> None:
        """Answer VIDIOC_QUERYBUF."""
        ctypes.pointer(buffer)[0] = self._slot(fd, buffer).info

    def mapping(self, fd: int, length: int, offset: int) -> mmap.mmap:
        """Answer mmap(2)."""
        for slot in self._slots:
            if slot.info.m.offset == offset and slot.info.length == length and fd == self.owner:
                return slot.memory
        raise os_error(errno.EINVAL)

    def queue(self, fd: int, buffer: v4l2.Buffer) -> None:
        """Answer VIDIOC_QBUF."""
        slot = self._slot(fd, buffer)
        check(slot.state is _State.DEQUEUED)
        slot.state = _State.QUEUED
        self._queued.append(slot)
        np.frombuffer(slot.memory, np.uint8)[:] = _REWRITTEN

    def dequeue(self, fd: int, buffer: v4l2.Buffer) -> None:
        """Answer VIDIOC_DQBUF of a non-blocking descriptor."""
        check(self.streaming and fd == self.owner and buffer.memory == v4l2.V4L2_MEMORY_MMAP)
        if not self._done:
            raise os_error(errno.EAGAIN)
        slot = self._done.popleft()
        slot.state = _State.DEQUEUED
        ctypes.pointer(buffer)[0] = slot.info

    def stream(self, fd: int) -> None:
        """Answer VIDIOC_STREAMON."""
        check(bool(self._slots) and fd == self.owner)
        self.streaming = True

    def check_free(self) -> None:
        """Raise EBUSY while somebody owns the buffers."""
        if self.owner is not None:
            raise os_error(errno.EBUSY)

    # What the camera does with them.

    @property
    def ready(self) -> bool:
        """Return whether a filled buffer waits."""
        return bool(self._done)

    def to_fill(self) -> Slot | None:
        """Return the next buffer to fill; None while the owner holds them all."""
        return self._queued.popleft() if self._queued else None

    def filled(self, slot: Slot) -> None:
        """Hand a filled buffer to the owner."""
        slot.state = _State.DONE
        self._done.append(slot)

    def _slot(self, fd: int, buffer: v4l2.Buffer) -> Slot:
        check(buffer.type == v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE and buffer.memory == v4l2.V4L2_MEMORY_MMAP)
        check(fd == self.owner and buffer.index < len(self._slots))
        return self._slots[buffer.index]


def check(allowed: bool) -> None:
    """Raise EINVAL unless `allowed`."""
    if not allowed:
        raise os_error(errno.EINVAL)


def os_error(number: int) -> OSError:
    """Return the error of a system call that fails with errno `number`."""
    return OSError(number, os.strerror(number))
