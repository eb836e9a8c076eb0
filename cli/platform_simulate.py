"""`gaiteyes platform simulate`: a recording of the simulated platform."""

from pathlib import Path
from typing import Annotated

import typer

from cli.options import JsonFile


def simulate(
    out: Annotated[Path, typer.Option(help="Folder to write the recording to.")],
    foot: Annotated[bool, typer.Option("--foot", help="With the mockup foot on the plate.")] = False,
    rate: Annotated[float, typer.Option(min=1.0, max=175.0, help="Updates of the actuators per second.")] = 40.0,
    seconds: Annotated[float, typer.Option(min=2.0, max=600.0, help="Length of the run.")] = 60.0,
    seed: Annotated[int, typer.Option(min=0, help="Draws the actuators' input and the noise.")] = 1,
    noise: Annotated[bool, typer.Option(help="With the thesis's sensor noise.")] = True,
    raw: Annotated[bool, typer.Option("--raw", help="Torque steps sampled without an anti-alias filter.")] = False,
    picture: Annotated[
        Path | None, typer.Option(help="Also draw the run: .png, .svg, .pdf, or .gif to animate.")
    ] = None,
    extended: Annotated[
        Path | None, typer.Option(help="extended.toml of `explain platform`: simulate its effects and its body.")
    ] = None,
    json: JsonFile = None,
) -> None:
    """Simulate the vibrating platform and write what its instruments record.

    The truth is written too, into a table that no estimator reads. A recording with the foot states the plate's
    inertia, as if an earlier run had measured it. Effects are simulated by other formulas than the finder's; one that
    the rig has no mechanism for is refused.
    """
    import numpy as np

    from cli.console import check_writable, table, write_json
    from messages.errors import UserError
    from messages.extras import needs

    check_writable(json)
    needs("gaiteyes platform simulate", "mujoco")
    if picture is not None:
        needs("--picture", "matplotlib")
    from cli.progress import working
    from discrepancy.report.extended import read_extended
    from sim_rig.platform.extended.simulate import Run
    from sim_rig.platform.extended.simulate import extended as simulated_extended
    from sim_rig.platform.picture import draw
    from sim_rig.platform.rig import FOOT, PLATE, THESIS_NOISE, Rig
    from sim_rig.platform.run import RunSettings, measured
    from sim_rig.platform.run import simulate as simulated

    if extended is not None:
        if picture is not None:
            raise UserError("--picture: draws the rig as it is, without --extended")
        model = read_extended(extended, "platform")
        settings = Run(foot=foot, update_hz=rate, duration_s=seconds, seed=seed, noise=noise, raw=raw)
        with working("simulating"):
            recording, truth = simulated_extended(settings, model.parameters, model.effects, str(extended))
    else:
        rig = Rig(foot=FOOT if foot else None)
        with working("simulating"):
            run = simulated(RunSettings(rig=rig, update_hz=rate, duration_s=seconds, raw=raw), seed)
        recording, truth = measured(run, THESIS_NOISE if noise else None, seed, PLATE if foot else None), run.truth
        if picture is not None:
            draw(run, picture)
    recording.save(out, truth)
    names = ("θ about Z, °", "φ about X, °", "fx, N", "fy, N", "fz, N", "tx, N m", "ty, N m", "tz, N m")
    channels = np.hstack((np.rad2deg(recording.plate.euler_rad[:, 1:]), recording.wrench))
    deviations, largest = channels.std(axis=0).tolist(), np.abs(channels).max(axis=0).tolist()
    table(
        f"{out}: {len(recording.t_s)} samples, {seconds:g} s, seed {seed}",
        ["", "standard deviation", "largest"],
        [[name, f"{s:.3g}", f"{m:.4g}"] for name, s, m in zip(names, deviations, largest, strict=True)],
    )
    if json is not None:
        sizes = {name: {"deviation": s, "largest": m} for name, s, m in zip(names, deviations, largest, strict=True)}
        write_json(json, {"folder": str(out), "samples": len(recording.t_s), "seed": seed, "channels": sizes})
