"""Which V4L2 cameras there are, what each delivers, and the name under which it is found again after a replug."""

import re
from collections.abc import Iterator
from enum import Enum
from pathlib import Path

import msgspec

from drivers.camera import v4l2_abi as v4l2
from drivers.camera.v4l2_device import Kernel
from drivers.camera.v4l2_formats import GREY_FORMATS, ListedStruct, Offer, WantedFormat, listed

SIDE_BY_SIDE = 2.4
"""From this ratio of width to height on a picture holds two eyes: two of 5:4 have 2.5, the widest single one 2.39."""
USUAL_HEIGHT_PX = 720
_NODE = re.compile(r"video(\d+)")
_LASTING = ("v4l/by-id", "v4l/by-path")


class CameraKind(str, Enum):
    """What a camera delivers."""

    SIDE_BY_SIDE = "side by side"  # both eyes in one picture
    DEPTH = "depth"
    SINGLE = "single"  # one eye


class FoundCamera(msgspec.Struct, frozen=True, kw_only=True):
    """A camera: its lasting path if it has one, what it calls itself, and the size of one eye's picture to run it at.

    The size is the one whose height is nearest to 720.
    """

    path: str
    card: str
    kind: CameraKind
    width_px: int
    height_px: int

    def __str__(self) -> str:
        """Return it as a person reads it."""
        return f"{self.card} ({self.kind.value}, {self.width_px}x{self.height_px}) at {self.path}"


def find_cameras(root: Path, kernel: Kernel) -> Iterator[FoundCamera | str]:
    """Yield every camera below `root`/dev whose pictures can be used, and a remark on each that cannot be asked."""
    names = (_NODE.fullmatch(node.name) for node in (root / "dev").glob("video*"))
    for number in sorted(int(match[1]) for match in names if match is not None):
        node = root / "dev" / f"video{number}"
        try:
            found = _asked(kernel, str(node), str(_lasting(root, node)))
        except OSError as error:
            yield f"{node}: {error.strerror}"
        else:
            if found is not None:
                yield found


def _lasting(root: Path, node: Path) -> Path:
    for folder in _LASTING:
        for link in sorted((root / "dev" / folder).glob("*")):
            if link.resolve() == node.resolve():
                return link
    return node


def _asked(kernel: Kernel, node: str, path: str) -> FoundCamera | None:
    """Return what is behind a node; None if it captures no pictures that a driver takes. Raises OSError."""
    fd = kernel.open(node)
    try:
        capability = v4l2.Capability()
        kernel.ioctl(fd, v4l2.VIDIOC_QUERYCAP, capability)
        caps = capability.capabilities
        if caps & v4l2.V4L2_CAP_DEVICE_CAPS:
            caps = capability.device_caps
        if not (caps & v4l2.V4L2_CAP_VIDEO_CAPTURE and caps & v4l2.V4L2_CAP_STREAMING):
            return None

        def exists(request: int, argument: ListedStruct) -> bool:
            try:
                kernel.ioctl(fd, request, argument)
            except OSError:
                return False
            return True

        any_size = WantedFormat((*GREY_FORMATS, v4l2.V4L2_PIX_FMT_Z16), 1280, USUAL_HEIGHT_PX, "")
        offers = listed(exists, any_size).offers
    finally:
        kernel.close(fd)
    return _chosen(offers, path, capability.card.decode(errors="replace"))


def _chosen(offers: list[Offer], path: str, card: str) -> FoundCamera | None:
    depth = [offer for offer in offers if offer.fourcc == v4l2.V4L2_PIX_FMT_Z16]
    if not offers:
        return None
    _, width, height = min((_unfitness(offer), *offer.largest) for offer in depth or offers)
    kind = CameraKind.DEPTH if depth else CameraKind.SINGLE
    if not depth and width / height >= SIDE_BY_SIDE:
        kind, width = CameraKind.SIDE_BY_SIDE, width // 2
    return FoundCamera(path=path, card=card, kind=kind, width_px=width, height_px=height)


def _unfitness(offer: Offer) -> tuple[bool, int]:
    """Return what sorts sizes, the fittest first: such as show two eyes, then by how far off the usual height is."""
    width, height = offer.largest
    return width / height < SIDE_BY_SIDE, abs(height - USUAL_HEIGHT_PX)
