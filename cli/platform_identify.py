"""`gaiteyes platform identify` and `design`: what a recording tells of ten parameters, and how to learn more."""

from pathlib import Path
from typing import Annotated

import typer

from cli.options import JsonFile


def identify(
    recording: Annotated[Path, typer.Argument(help="Folder of the recording: platform.toml and its CSV files.")],
    plate: Annotated[Path | None, typer.Option(help="Recording of the bare plate, to identify the foot.")] = None,
    joint: Annotated[
        bool | None,
        typer.Option("--joint/--no-joint", help="Assume the universal joint; by default decided from the markers."),
    ] = None,
    weighed: Annotated[
        bool, typer.Option(help="Use the plate's stated mass, unless the motion contradicts it.")
    ] = True,
    out: Annotated[Path | None, typer.Option(help="Folder for report.html.")] = None,
    json: JsonFile = None,
) -> None:
    """Identify the plate, or the foot where one is mounted: ten parameters with 95 % intervals."""
    from cli.console import check_writable, console, table, write_json
    from cli.progress import working
    from impedance.identification.checks import HEADING as CHECK_HEADING
    from impedance.identification.identification import identify as identified
    from impedance.identification.report import HEADING, check_rows, facts, parameter_rows, remarks, write_report
    from impedance.recording.recording import PlatformRecording

    check_writable(json)
    with working("identifying"):
        known = None if plate is None else identified(PlatformRecording.load(plate), joint=joint, weighed=weighed).known
        found = identified(PlatformRecording.load(recording), known, joint, weighed=weighed)
    table("Instruments, as markers and misfit see them", CHECK_HEADING, check_rows(found))
    table(f"Inertia of the {found.what}, about its centre of gravity", HEADING, parameter_rows(found))
    for remark in remarks(found):
        console.print(f"- {remark}")
    if out is not None:
        write_report(found, out, [path for path in (recording, plate) if path is not None])
    if json is not None:
        write_json(json, facts(found))


def design(
    acceleration: Annotated[float, typer.Option(min=1.0, help="Maximum angular acceleration, rad/s².")] = 150.0,
    rate: Annotated[float, typer.Option(min=0.01, help="Maximum angular rate, rad/s.")] = 3.0,
    highest: Annotated[float, typer.Option(min=2.0, max=60.0, help="Highest frequency of the excitation, Hz.")] = 25.0,
    share: Annotated[
        float, typer.Option(min=0.001, max=0.5, help="Wanted half width of J_yy's 95 % interval, as a share.")
    ] = 0.02,
    seed: Annotated[int, typer.Option(min=0, help="Draws the starts of the search.")] = 1,
    json: JsonFile = None,
) -> None:
    """Design the excitation that determines J_yy best: least time per amplitude, and the bound for any motion."""
    import numpy as np

    from cli.console import check_writable, table, write_json
    from cli.progress import progress
    from impedance.identification.experiment import MotionLimits
    from sim_rig.platform.design import AMPLITUDES_DEG, COLUMNS, designed_for

    check_writable(json)
    designs = [
        designed_for(MotionLimits(np.deg2rad(degrees), rate, acceleration, highest_hz=highest), share, seed)
        for degrees in progress(AMPLITUDES_DEG, "designing")
    ]
    table(
        f"Time for J_yy of the plate to ± {100.0 * share:g} % (95 %), at the thesis's noise; at most "
        f"{rate:g} rad/s and {acceleration:g} rad/s², lines up to {highest:g} Hz",
        COLUMNS,
        [each.row for each in designs],
    )
    if json is not None:
        write_json(json, [each.facts for each in designs])
