"""Two small cameras of one eye each on fake nodes with a common clock, and the pair on them."""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.camera.pair import V4l2CameraPair
from sim_rig.camera.v4l2_machine import V4l2Machine
from sim_rig.camera.v4l2_node import EyeScene, ManualClock, Mode, V4l2Node, stepping_card

WIDTH, HEIGHT = 64, 32
T0_NS = 1_000_000_000_000
LEFT, RIGHT = "/dev/video0", "/dev/video2"


def eye_scene(eye: int, width_px: int = WIDTH, height_px: int = HEIGHT) -> EyeScene:
    """Return the stepping card of one eye."""
    card = stepping_card(width_px, height_px)
    return lambda frame: (card(frame)[eye],)


@dataclass
class Cameras:
    """The two nodes, and the machine they hang on."""

    left: V4l2Node
    right: V4l2Node

    def __post_init__(self) -> None:
        self.machine = V4l2Machine((self.left, self.right))

    def pair(self, *, max_skew_s: float = 0.001, pool_frames: int = 4, rate_hz: int = 60) -> V4l2CameraPair:
        """Return the project's driver on them."""
        width, height = self.left.modes[0][1:3]
        return V4l2CameraPair(
            LEFT,
            RIGHT,
            width,
            height,
            pool_frames=pool_frames,
            max_skew_s=max_skew_s,
            rate_hz=rate_hz,
            kernel=self.machine,
        )


def jitter_s(seed: int, sigma_s: float) -> Callable[[int], float]:
    """Return an error of each frame's stamp, the same whenever asked for."""

    def error_s(frame: int) -> float:
        return sigma_s * (((frame + 1) * (2 * seed + 7919) % 1000) / 500.0 - 1.0)

    return error_s


def cameras(
    left: dict[str, object] | None = None,
    right: dict[str, object] | None = None,
    *,
    code: str = "GREY",
    size: tuple[int, int] = (WIDTH, HEIGHT),
) -> Cameras:
    """Return two cameras; `left` and `right` are options of their nodes."""
    clock = ManualClock(T0_NS)
    nodes = []
    for eye, (path, options) in enumerate(((LEFT, left), (RIGHT, right))):
        plain: dict[str, object] = {
            "scene": eye_scene(eye, *size),
            "clock": clock,
            "path": path,
            "card": f"Eye {eye}",
            "modes": (Mode(code, *size),),
        }
        nodes.append(V4l2Node(**(plain | (options or {}))))  # type: ignore[arg-type]  # options of many types
    return Cameras(*nodes)
