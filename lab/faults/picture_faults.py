"""The catalogue's camera, continued: what its pictures show."""

from collections.abc import Callable

from lab.faults import spoilt_pictures as spoilt
from lab.faults.bench import Bench
from lab.faults.camera_faults import contradiction, missing, other
from lab.faults.fault import Expect, Tamper
from lab.faults.played_camera import Spoil


def _spoiling(make: Callable[[], Spoil]) -> Tamper:
    def inject(bench: Bench) -> None:
        bench.camera.spoils["fault"] = make()

    return Tamper(inject, lambda bench: bench.camera.spoils.clear())


PICTURE_FAULTS = (
    missing("cam-frozen", "the same picture again and again, with new stamps", _spoiling(spoilt.frozen), "pictures"),
    contradiction(
        "cam-frozen-noisy",
        "the same scene again and again, with fresh noise",
        _spoiling(spoilt.frozen_but_noisy),
        "pictures",
    ),
    contradiction("cam-eyes-swapped", "left and right are exchanged", _spoiling(spoilt.swapped), "pictures"),
    missing(
        "cam-left-black", "the left eye is covered", _spoiling(lambda: spoilt.black(left=True, right=False)), "pictures"
    ),
    missing(
        "cam-right-black",
        "the right eye is covered",
        _spoiling(lambda: spoilt.black(left=False, right=True)),
        "pictures",
    ),
    missing(
        "cam-both-black", "both eyes are covered", _spoiling(lambda: spoilt.black(left=True, right=True)), "pictures"
    ),
    missing("cam-over-exposed", "both pictures are white", _spoiling(lambda: spoilt.exposed(60.0)), "pictures"),
    missing("cam-under-exposed", "a hundredth of the light", _spoiling(lambda: spoilt.exposed(0.01)), "pictures"),
    missing("cam-no-texture", "ground without any texture", _spoiling(spoilt.textureless), "pictures"),
    other(
        "cam-bright",
        "twice the light, bright parts cut off",
        _spoiling(lambda: spoilt.exposed(2.0)),
        Expect.HONEST,
        "what is not cut off can be matched",
        "pictures",
    ),
    other(
        "cam-darkening",
        "the light fades to a fiftieth within 3 s",
        _spoiling(lambda: spoilt.darkening(0.937)),
        Expect.HONEST,
        "valid as long as enough can be matched",
        "pictures",
    ),
    other(
        "cam-wet-lens",
        "water on the left lens blurs it by 25 px",
        _spoiling(lambda: spoilt.blurred_left(25)),
        Expect.HONEST,
        "valid as long as enough can be matched",
        "pictures",
    ),
    other(
        "cam-dirty-lens",
        "a blob of mud hides part of the left picture",
        _spoiling(lambda: spoilt.dirty_left(130)),
        Expect.HONEST,
        "the rest of the foothold may suffice",
        "pictures",
    ),
    other(
        "cam-torn",
        "the lower half of each picture is a frame older",
        _spoiling(spoilt.torn),
        Expect.HONEST,
        "both eyes agree; half the region is 50 ms old and the plane is refused, or within its stated error",
        "pictures",
    ),
    contradiction(
        "cam-right-eye-late",
        "the right picture is a frame older than the left one",
        _spoiling(spoilt.right_eye_late),
        "pictures",
    ),
    contradiction(
        "cam-slipped-vertically",
        "the right camera has slipped: its picture is 4 px lower",
        _spoiling(lambda: spoilt.right_eye_shifted(4, 0)),
        "pictures",
    ),
    contradiction(
        "cam-turned-15",
        "the camera is rolled by 15° on its mount",
        _spoiling(lambda: spoilt.turned(0.0, 15.0)),
        "pictures",
    ),
    other(
        "cam-turned-3",
        "the camera is pitched by 3° on its mount",
        _spoiling(lambda: spoilt.turned(3.0, 0.0)),
        Expect.UNDETECTABLE,
        "turns a rate about an axis by 5 %, below what motion tells; only a known slope would show it",
        "",
        6.0,
    ),
    other(
        "cam-slipped-sideways",
        "the right camera has turned inwards: its picture is 4 px to the right",
        _spoiling(lambda: spoilt.right_eye_shifted(0, 4)),
        Expect.UNDETECTABLE,
        "a toe-in is the same as other ground nearer or farther: only a known height would show it",
        "",
        6.0,
    ),
)
