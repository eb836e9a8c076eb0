"""A real floor in depth pictures of a robot that drives: `python -m benchmarks.robot_floor`.

Reads $GAITEYES_DATA/realsense_robot_floor. Nothing was tuned on it.
"""

import numpy as np

from lab.evaluation.measured.data_folder import data_folder
from lab.evaluation.measured.robot_floor import floors_seen


def main() -> None:
    seen = floors_seen(data_folder("realsense_robot_floor"))
    valid = [floor for floor in seen if np.isfinite(floor.height_m)]
    heights_mm = 1e3 * np.array([floor.height_m for floor in valid])
    slopes_deg = np.degrees([floor.slopes_rad for floor in valid])
    print(f"{len(valid)} of {len(seen)} pictures have a floor")
    print(
        f"height {heights_mm.mean():.1f} mm, RMS about it {heights_mm.std():.1f} mm, range {np.ptp(heights_mm):.1f} mm"
    )
    print(
        f"slopes, RMS about their mean: {slopes_deg.std(axis=0)[0]:.2f}° ahead, {slopes_deg.std(axis=0)[1]:.2f}° across"
    )
    for floor in seen:
        for edge in floor.edges:
            print(f"{floor.name}: an edge at {edge.distance_m:.2f} m, {1e3 * edge.rise_m:+.0f} mm")


if __name__ == "__main__":
    main()
