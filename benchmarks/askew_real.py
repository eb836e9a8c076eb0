"""An eye that stands askew, on real pictures: is it told, and what does the ground say where it is not?

    python -m benchmarks.askew_real

The ten frames of EuRoC's floor (`shared/data/euroc_v1_01_easy`) with the right eye's pictures turned about the upright
axis of the picture (toed), or about the optical axis (rolled), as the calibration does not know. Slopes and height are
those of the last valid frame; the first row is the floor as it was recorded. Prints one line where the data are absent.
"""

from collections import Counter

import cv2
import msgspec
import numpy as np

from daemon.pipeline import Pipeline
from daemon.replay_source import open_source
from lab.evaluation.measured.data_folder import data_folder
from lab.faults.deformed_view import turned_eye
from messages import Calibration, GroundPlane, Status, StereoFrame, UserError
from perception import so3

AXES = {"toed": np.array([0.0, 1.0, 0.0]), "rolled": np.array([0.0, 0.0, 1.0])}
TURNS_DEG = (-1.5, -1.0, -0.5, -0.2, 0.2, 0.5, 1.0, 1.5)


def line(name: str, deg: float) -> str:
    """Return one line of the table."""
    source = open_source(data_folder("euroc_v1_01_easy"), None)
    if not isinstance(source.calibration, Calibration):
        raise UserError("EuRoC's floor: its calibration must be that of two eyes")
    change = turned_eye(source.calibration.stereo, so3.exp(np.radians(deg) * AXES[name]), left=False)
    pipeline, reasons = Pipeline(source.calibration, source.configuration.foothold), Counter[str]()
    last = "none valid"
    for message in source.inputs():
        if deg and isinstance(message, StereoFrame):
            left, right = change((message.left, message.right))
            message = msgspec.structs.replace(message, left=left, right=right)
        for told in pipeline.step(message):
            if not isinstance(told, GroundPlane) or told.frame_seq < 0:
                continue
            reasons["valid" if told.status is Status.VALID else told.reason.value] += 1
            if told.status is Status.VALID:
                sagittal, frontal = np.degrees((told.slope_sagittal_rad, told.slope_frontal_rad))
                last = f"{sagittal:5.1f}°, {frontal:5.1f}°, {1e3 * told.height_m:5.0f} mm"
    return f"{name:8}{deg:5.1f}°  {last:28}" + ", ".join(f"{reason} {count}" for reason, count in reasons.items())


def main() -> None:
    cv2.setNumThreads(1)
    try:
        print(line("toed", 0.0))
        for name in AXES:
            for deg in TURNS_DEG:
                print(line(name, deg), flush=True)
    except UserError as absent:
        print(absent)


if __name__ == "__main__":
    main()
