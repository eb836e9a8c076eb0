"""A picture or an animation of a run: plate, foot, upper frame and the three frames' axes, tilted as they were."""

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from impedance.body import geometry
from messages.arrays import FloatArray
from messages.errors import UserError
from messages.extras import needs
from sim_rig.platform.run import SimulatedRun

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

PLATE_M: Final = (0.5, 0.0288, 0.2985)
FOOT_M: Final = (0.20, 0.1814, 0.18)
FRAME_M: Final = (0.40, 0.03, 0.22)
"""Sizes along x, y, z. The plate's are those of the thesis's ideal cuboid; the others are drawn for the eye alone."""
EXAGGERATED: Final = 5.0
"""A swing of 1° is hardly seen: angles are drawn five times as large."""
ANIMATED_S: Final = 2.0
FRAMES_PER_S: Final = 25

_AXIS_M: Final = 0.18
_REACH_M: Final = 0.36


def draw(run: SimulatedRun, path: Path) -> None:
    """Write a picture at the widest swing, or where the name ends in .gif an animation of the first two seconds.

    Raises UserError for another ending, where matplotlib is absent, or where the file cannot be written.
    """
    kind = path.suffix.lower()
    if kind not in (".png", ".svg", ".pdf", ".gif"):
        raise UserError(f"{path}: a picture's name ends in .png, .svg, .pdf or .gif")
    needs("a picture", "matplotlib")
    from matplotlib.animation import FuncAnimation, PillowWriter
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 6.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes: Axes3D = figure.add_subplot(projection="3d")
    try:
        if kind == ".gif":
            stride = max(1, round(len(run.t_s) / (run.t_s[-1] * FRAMES_PER_S)))
            shown = range(0, int(np.searchsorted(run.t_s, ANIMATED_S)), stride)
            animation = FuncAnimation(figure, lambda k: _draw_pose(axes, run, k), frames=shown)
            animation.save(path, PillowWriter(fps=FRAMES_PER_S))
        else:
            _draw_pose(axes, run, int(np.argmax(np.abs(run.angles_rad).sum(axis=1))))
            figure.savefig(path, dpi=150)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error


def _draw_pose(axes: "Axes3D", run: SimulatedRun, k: int) -> None:
    rig = run.settings.rig
    theta, phi = run.angles_rad[k]
    angles = EXAGGERATED * run.angles_rad[k : k + 1]
    p_IP, euler = geometry.joint_pose(angles[:, 0], angles[:, 1], rig.joint_to_surface_m)
    R_IP = geometry.rotation_IP(*euler.T)[0]
    axes.clear()
    _draw_box(axes, R_IP, R_IP @ np.array([0.0, 0.4 * rig.joint_to_surface_m, 0.0]), FRAME_M, "0.75")
    _draw_box(axes, R_IP, p_IP[0] - R_IP @ np.array([0.0, 0.5 * PLATE_M[1], 0.0]), PLATE_M, "tab:blue")
    _draw_axes(axes, np.eye(3), np.zeros(3), "I")
    _draw_axes(axes, R_IP, p_IP[0], "P")
    if rig.foot is not None:
        origin = p_IP[0] + R_IP @ np.array(rig.foot_origin_m)
        _draw_box(axes, R_IP, origin - R_IP @ np.array([0.0, 0.5 * FOOT_M[1], 0.0]), FOOT_M, "tab:orange")
        _draw_axes(axes, R_IP, origin, "F")
    axes.set_xlim(-_REACH_M, _REACH_M)
    axes.set_ylim(_REACH_M, -_REACH_M)
    axes.set_zlim(-0.1, 2.0 * _REACH_M - 0.1)
    axes.set(xlabel="x, m", ylabel="z, m", zlabel="y, m")
    axes.set_box_aspect((1.0, 1.0, 1.0))
    axes.view_init(elev=18.0, azim=-62.0)
    turned = ", ".join(f"{name} = {np.rad2deg(angle):+.2f}°" for name, angle in (("θ", theta), ("φ", phi)))
    axes.set_title(f"t = {run.t_s[k]:.2f} s, {turned} (drawn {EXAGGERATED:g} times as large)")


def _draw_box(
    axes: "Axes3D", R: FloatArray, centre: FloatArray, size_m: tuple[float, float, float], colour: str
) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    signs = np.array([(-1, -1), (-1, 1), (1, 1), (1, -1)]) * 0.5
    sides = []
    for axis in range(3):
        for end in (-0.5, 0.5):
            corners = np.insert(signs, axis, end, axis=1) * np.array(size_m)
            sides.append(_drawn(centre + corners @ R.T))
    axes.add_collection3d(Poly3DCollection(sides, facecolor=colour, edgecolor="0.2", linewidth=0.6, alpha=0.45))


def _draw_axes(axes: "Axes3D", R: FloatArray, origin: FloatArray, name: str) -> None:
    for axis, colour in enumerate(("tab:red", "tab:green", "tab:purple")):
        line = _drawn(np.stack((origin, origin + _AXIS_M * R[:, axis])))
        axes.plot(*line.T, color=colour, linewidth=1.8)
        axes.text(*line[1], f"{'XYZ'[axis]}_{name}", fontsize=8)


def _drawn(points: FloatArray) -> FloatArray:
    """Return points of I (n, 3), Y up, in the plot's order: x, z, up."""
    return points[:, [0, 2, 1]]
