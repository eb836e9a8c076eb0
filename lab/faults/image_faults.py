"""Faults of the camera's images: frozen, swapped, dark, blurred, shifted."""

from collections.abc import Callable

import msgspec
import numpy as np

from lab.faults import deformed_view, image_changes
from lab.faults.camera_faults import contradiction, missing, other
from lab.faults.fault import MOTION_FLAG_S, USB_RECOVERY_S, Expect, Fault, HardwareAction, Layer, Restart
from lab.faults.faulty_camera import ImageChange
from lab.faults.hardware import FaultyHardware


def _changing(make: Callable[[], ImageChange]) -> HardwareAction:
    def inject(hardware: FaultyHardware) -> None:
        hardware.camera.image_changes["fault"] = make()

    return HardwareAction(inject, lambda hardware: hardware.camera.image_changes.clear())


IMAGE_FAULTS = (
    missing(
        "cam-frozen", "the same image again and again, with new time stamps", _changing(image_changes.frozen), "images"
    ),
    contradiction(
        "cam-frozen-noisy",
        "the same scene again and again, with fresh noise",
        _changing(image_changes.frozen_but_noisy),
        "images",
    ),
    contradiction(
        "cam-eyes-swapped", "left and right images are exchanged", _changing(image_changes.swapped), "images"
    ),
    missing(
        "cam-left-black",
        "the left camera is covered",
        _changing(lambda: image_changes.black(left=True, right=False)),
        "images",
    ),
    missing(
        "cam-right-black",
        "the right camera is covered",
        _changing(lambda: image_changes.black(left=False, right=True)),
        "images",
    ),
    missing(
        "cam-both-black",
        "both cameras are covered",
        _changing(lambda: image_changes.black(left=True, right=True)),
        "images",
    ),
    missing("cam-over-exposed", "both images are white", _changing(lambda: image_changes.exposed(60.0)), "images"),
    missing(
        "cam-under-exposed",
        "both images have a hundredth of their brightness",
        _changing(lambda: image_changes.exposed(0.01)),
        "images",
    ),
    missing("cam-no-texture", "the ground has no texture", _changing(image_changes.textureless), "images"),
    other(
        "cam-bright",
        "both images are twice as bright, bright parts saturated",
        _changing(lambda: image_changes.exposed(2.0)),
        Expect.HONEST,
        "parts that are not saturated can still be matched",
        "images",
    ),
    other(
        "cam-darkening",
        "the light fades to a fiftieth within 3 s",
        _changing(lambda: image_changes.darkening(0.937)),
        Expect.HONEST,
        "valid as long as enough can be matched",
        "images",
    ),
    other(
        "cam-wet-lens",
        "water on the left lens blurs it by 25 px",
        _changing(lambda: image_changes.blurred_left(25)),
        Expect.HONEST,
        "valid as long as enough can be matched",
        "images",
    ),
    other(
        "cam-dirty-lens",
        "dirt hides part of the left image",
        _changing(lambda: image_changes.dirty_left(130)),
        Expect.HONEST,
        "the rest of the foothold region may suffice",
        "images",
    ),
    other(
        "cam-torn",
        "the lower half of each image is one frame older",
        _changing(image_changes.torn),
        Expect.HONEST,
        "both images agree; half the region is 50 ms old, and the plane is marked invalid or within its stated error",
        "images",
    ),
    contradiction(
        "cam-right-eye-late",
        "the right image is one frame older than the left one",
        _changing(image_changes.right_late),
        "images",
    ),
    contradiction(
        "cam-slipped-vertically",
        "the right camera has slipped in its mount: its image is 4 px lower",
        _changing(lambda: image_changes.right_shifted(4, 0)),
        "images",
    ),
    contradiction(
        "cam-drop",
        "a drop on the left lens moves part of the picture by up to 2 px",
        _changing(lambda: deformed_view.warped(deformed_view.drop(np.random.default_rng(14)).of_size(2.0), left=True)),
        "images",
    ),
    contradiction(
        "cam-window-bent",
        "the window before the right lens is bent: parts of the picture are moved by up to 1 px",
        _changing(lambda: deformed_view.warped(deformed_view.bent(np.random.default_rng(14)).of_size(1.0), left=False)),
        "images",
    ),
    other(
        "cam-half-covered",
        "a cloth hides the left half of the right image",
        _changing(lambda: deformed_view.covered("left", left=False)),
        Expect.HONEST,
        "the rest of the foothold region may suffice",
        "images",
    ),
    contradiction(
        "cam-mirrored",
        "both images are mirrored, and the eyes exchanged, in mid-walk",
        _changing(lambda: deformed_view.mirrored),
        "images",
    ),
    contradiction(
        "cam-upside-down",
        "both images turn upside down in mid-walk",
        _changing(lambda: deformed_view.upside_down),
        "images",
    ),
    contradiction(
        "cam-turned-15",
        "the camera is rolled by 15° on its mount",
        _changing(lambda: image_changes.turned(0.0, 15.0)),
        "images",
    ),
    contradiction(
        "cam-turned-3",
        "the camera is pitched by 3° on its mount",
        _changing(lambda: image_changes.turned(3.0, 0.0)),
        "images",
    ),
    contradiction(
        "cam-slipped-sideways",
        "the right camera has turned inwards: its image is 4 px to the right",
        _changing(lambda: image_changes.right_shifted(0, 4)),
        "images",
    ),
    contradiction(
        "cam-slipped-outwards",
        "the right camera has turned outwards: its image is 4 px to the left",
        _changing(lambda: image_changes.right_shifted(0, -4)),
        "images",
    ),
    contradiction(
        "cam-window-stretched",
        "a window bent about the vertical makes the right image wider, by 2 px on either side of the foothold",
        _changing(lambda: deformed_view.warped(deformed_view.stretched(2.0), left=False)),
        "images",
    ),
    Fault(
        name="cam-window-stretched-first",
        layer=Layer.CAMERA,
        how="the same window, there before the daemon starts",
        act=Restart(lambda plan, _folder: msgspec.structs.replace(plan, from_start=("cam-window-stretched",))),
        expect=Expect.FLAGGED,
        limit_s=MOTION_FLAG_S,
        hold_s=6.0,
        recovery_s=USB_RECOVERY_S,
        in_motion=True,
    ),
)
