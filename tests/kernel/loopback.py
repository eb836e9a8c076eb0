"""A v4l2loopback node fed by a thread, and the project's driver on it."""

import itertools
import threading
import time
from pathlib import Path

from drivers.camera.side_by_side import V4l2StereoCamera
from sim_rig.camera.v4l2_node import Scene, stepping_card
from sim_rig.kernel.loopback_camera import LoopbackCamera
from tests.kernel.modules import load_module

NUMBER = 20
NODE = f"/dev/video{NUMBER}"
EYE_PX = (96, 40)
FEED_HZ = 20


class FedLoopback:
    """Shows `scene` 20 times a second from `plug_in` to `unplug`."""

    def __init__(self, eye_px: tuple[int, int] = EYE_PX, scene: Scene | None = None) -> None:
        if not Path(NODE).exists():
            load_module("v4l2loopback", f"video_nr={NUMBER}", "exclusive_caps=1", "card_label=rig", "max_buffers=8")
        self._eye_px = eye_px
        self._scene = stepping_card(*eye_px) if scene is None else scene
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self.plug_in()

    def camera(self, *, pool_frames: int = 4) -> V4l2StereoCamera:
        """Return the project's driver on it."""
        return V4l2StereoCamera(NODE, *self._eye_px, pool_frames=pool_frames)

    def plug_in(self) -> None:
        """Feed the node."""
        writer = LoopbackCamera(NODE, *self._eye_px)
        writer.show(*self._scene(0))
        self._ended.clear()
        self._thread = threading.Thread(target=self._feed, args=(writer,), name="loopback", daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Stop feeding it."""
        if self._thread is not None:
            self._ended.set()
            self._thread.join()
            self._thread = None

    def _feed(self, writer: LoopbackCamera) -> None:
        start_s = time.monotonic()
        for frame in itertools.count(1):
            if self._ended.wait(max(0.0, start_s + frame / FEED_HZ - time.monotonic())):
                writer.close()
                return
            writer.show(*self._scene(frame))
