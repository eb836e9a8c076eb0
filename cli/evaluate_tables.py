"""The tables of `gaiteyes evaluate`, for a person."""

import math
from collections.abc import Sequence

from lab.evaluation.attitude import UNCALIBRATED
from lab.evaluation.causes.ledger import CauseScore
from lab.evaluation.causes.recorded import Explained
from lab.evaluation.imu_logs.score import FIRST_S, FROM_S, Together, TrialScore
from reports.content import Table


def attitude_table(name: str, scores: Sequence[TrialScore], pooled: Together) -> Table:
    """Return inclination errors log by log, and of all logs together."""
    rows = [
        [
            each.name,
            *map(_number, (each.this_filter.rms_deg, each.this_filter.p99_deg, each.this_filter.first_p99_deg)),
            _share(each.coverage),
            _number(each.stated_deg),
            *map(_number, (each.vqf.rms_deg, each.vqf.p99_deg, each.vqf.first_p99_deg, each.vqf_defaults.rms_deg)),
        ]
        for each in scores
    ]
    means = (pooled.mean_rms_deg, pooled.mean_first_p99_deg, pooled.vqf_mean_rms_deg, pooled.vqf_mean_first_p99_deg)
    ours_rms, ours_first, peer_rms, peer_first = map(_number, means)
    rows.append(["mean of the logs", ours_rms, "", ours_first, "", "", peer_rms, "", peer_first, ""])
    ours, peer = (
        list(map(_number, each))
        for each in (
            (pooled.pooled_rms_deg, pooled.pooled_p99_deg),
            (pooled.vqf_pooled_rms_deg, pooled.vqf_pooled_p99_deg),
        )
    )
    rows.append(["all errors", *ours, "", _share(pooled.pooled_coverage), "", *peer, "", ""])
    columns = ["", "RMS", "P99", "first P99", "in 95 %", "stated", "VQF RMS", "P99", "first P99", "defaults"]
    note = (
        f"Means to about 100 Hz, errors from {FROM_S:g} s on, 'first' up to {FIRST_S:g} s. One set of parameters, one "
        f"residual: {UNCALIBRATED.specific_force_mps2:g} m/s² and {UNCALIBRATED.scale:g}. 'in 95 %': in the stated "
        "ellipse. VQF has the bias of the first second and biasClip 10; the last column has its defaults."
    )
    return Table(f"{name}: inclination error, degrees", columns, rows, note)


def cause_table(title: str, scores: Sequence[CauseScore]) -> Table:
    """Return the error as measured, and for each cause what it makes of it and what is left without it."""
    return Table(
        title,
        ["", "replaced by", "frames", "slope ahead", "left", "across", "left", "height", "left"],
        [
            [
                each.name,
                each.replaced_by,
                str(each.frames),
                f"{each.part_sagittal_deg:.3f}°",
                f"{each.left_sagittal_deg:.3f}°",
                f"{each.part_frontal_deg:.3f}°",
                f"{each.left_frontal_deg:.3f}°",
                f"{each.part_height_mm:.1f} mm",
                f"{each.left_height_mm:.1f} mm",
            ]
            for each in scores
        ],
        "RMS. Of each cause what it makes: of the estimates' change where the truth takes its place. 'left' is the "
        "error without it. Causes cancel in single units, so the parts do not add up to the whole.",
    )


def explanation(found: Explained) -> str:
    """Return what explains a recording's errors best."""
    ahead, across = found.extrinsic_deg
    known = [f"a camera turned by {ahead:+.2f}° ahead and {across:+.2f}° across"]
    if math.isfinite(found.imu_bias_deg[0]):
        known.append("a tilt of {:+.2f}°, {:+.2f}°, {:+.2f}° about the IMU's axes".format(*found.imu_bias_deg))
    if math.isfinite(found.late_s):
        known.append(f"stamps {1e3 * found.late_s:+.1f} ms late")
    return f"Explained best by {', '.join(known)}."


def _number(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "–"


def _share(value: float) -> str:
    return f"{100 * value:.0f} %" if math.isfinite(value) else "–"
