"""`gaiteyes demo`: the simulated wearer in real time, through the same service as on hardware."""

from pathlib import Path
from typing import Annotated

import typer

from cli.options import JsonFile


def demo(
    seconds: Annotated[float, typer.Option(min=1.0, help="Length of the walk.")] = 60.0,
    scenario: Annotated[
        str, typer.Option(help="What is walked on, and how: mixed, level, bus …; an unknown name lists them all.")
    ] = "mixed",
    seed: Annotated[int, typer.Option(min=0, help="Number of the simulated unit and of its gait.")] = 1,
    speed: Annotated[float, typer.Option(help="Walking speed, m/s.")] = 1.2,
    cadence: Annotated[float, typer.Option(help="Steps per second.")] = 1.8,
    record: Annotated[
        Path | None, typer.Option(help="Record all inputs, outputs and the truth to this MCAP file.")
    ] = None,
    last: Annotated[float | None, typer.Option(min=1.0, help="Keep only the last seconds of the recording.")] = None,
    outputs_only: Annotated[
        bool, typer.Option(help="Record estimates alone: no picture, no sample; it cannot be replayed.")
    ] = False,
    config: Annotated[
        Path | None, typer.Option(help="Configuration file (TOML); by default the built-in settings.")
    ] = None,
    can: Annotated[str | None, typer.Option(help="CAN bus as INTERFACE:CHANNEL; by default a simulated one.")] = None,
    zenoh: Annotated[
        str | None, typer.Option(help="Zenoh endpoint to listen on; by default a socket that only you may enter.")
    ] = None,
    perfect_calibration: Annotated[
        bool, typer.Option(help="Calibration without its usual errors; results say so.")
    ] = False,
    prosthesis: Annotated[
        bool,
        typer.Option(
            help="Let a virtual prosthesis on the same CAN bus follow what it is told, and answer with its state."
        ),
    ] = False,
    bus_faults: Annotated[
        str, typer.Option(help="Faults of the prosthesis's bus, as loss=0.05,delay_s=0.02,babble_hz=500.")
    ] = "",
    json: JsonFile = None,
) -> None:
    """Let a simulated wearer walk, and judge the ground estimates.

    In real time, through the same service as on hardware.

    Exit code 4: the host was too busy, so that the figures are void.
    """
    from messages.extras import needs

    needs("gaiteyes demo", "skimage")

    import contextlib
    import time

    import msgspec

    from cli.console import VOID, check_writable, console, score_table, show, write_json
    from cli.filmed import film_if_slow
    from cli.live import LiveStatus
    from cli.wiring import (
        build_service,
        check_recording,
        open_outlets,
        open_recorder,
        stopped_by_signals,
        summary_tables,
        tell_recording,
    )
    from cli.worn_prosthesis import tell_prosthesis, with_set_points, worn_by
    from daemon.config import Configuration, load_configuration
    from daemon.summary import Tally
    from drivers.can.settings import parse_can
    from drivers.imu.mpu6050 import Mpu6050
    from drivers.imu.settings import Mpu6050Settings
    from drivers.zenoh.settings import ZenohSettings
    from lab.evaluation.busy_host import Burden, ProcessorPressure
    from lab.evaluation.truth_observer import TruthObserver
    from messages import TOPICS, DropCause, Source, UserError
    from sim_rig.camera.film import film_file
    from sim_rig.can.slcan_hub import open_hub
    from sim_rig.prosthesis.bus_faults import parse_faults
    from sim_rig.prosthesis.process import ProsthesisProcess, check_worn
    from sim_rig.walk.scenario import Pace
    from sim_rig.walk.scenario import scenario as scenario_named
    from sim_rig.wearer import SimulatedWearer

    check_writable(json)
    check_recording(record, last, outputs_only)
    configuration = Configuration(device="demo") if config is None else load_configuration(config)
    walk = scenario_named(scenario, Pace(speed_mps=speed, step_hz=cadence))
    faults = parse_faults(bus_faults)
    if prosthesis:
        configuration = with_set_points(configuration)
    elif bus_faults:
        raise UserError("--bus-faults are those of a prosthesis's bus: add --prosthesis")
    if can is not None:
        configuration = msgspec.structs.replace(configuration, can=parse_can(can))
    if zenoh is not None:
        configuration = msgspec.structs.replace(configuration, zenoh=ZenohSettings(listen=zenoh))
    worn = worn_facts = None
    still = SimulatedWearer(seed, walk, 0, perfect_calibration)

    def check() -> None:
        if prosthesis:
            check_worn(worn_by(configuration, seed, walk, 0), configuration.can, faults)
        open_outlets(configuration, still.calibration).close()

    with contextlib.ExitStack() as held:
        hub = None
        if can is None and config is None:
            hub = held.enter_context(contextlib.closing(open_hub()))
            configuration = msgspec.structs.replace(configuration, can=hub.settings)
        path = held.enter_context(film_file())
        film = film_if_slow(still, seconds, path, check)
        start_ns = time.monotonic_ns() + _LEAD_NS
        wearer = SimulatedWearer(seed, walk, start_ns, perfect_calibration, film=film)
        try:
            camera = wearer.camera()
            if prosthesis:
                worn = ProsthesisProcess(worn_by(configuration, seed, walk, start_ns), configuration.can, faults)
            imu = Mpu6050(wearer.imu_bus, settings=Mpu6050Settings(), open_data_ready=wearer.data_ready.open)
            imu.open()
            outlets = open_outlets(configuration, wearer.calibration)
            recorder = None
            tally = Tally()
            with outlets.closed_on_failure():
                if record is not None:
                    recorder = open_recorder(
                        record, configuration, wearer.calibration, Source.SIMULATED, last, outputs_only=outputs_only
                    )
                observer = TruthObserver(wearer, recorder)
                service = build_service(
                    configuration,
                    wearer.calibration,
                    Source.SIMULATED,
                    imu,
                    camera,
                    outlets,
                    recorder,
                    [tally, observer],
                    background={} if hub is None else {"can-hub": hub.serve},
                    priorities=config is not None and configuration.realtime.priorities,
                    folder=Path() if config is None else config.parent,
                )
            console.print("to see it, in another terminal: gaiteyes view", highlight=False)
            pressure = ProcessorPressure()
            with stopped_by_signals(service), LiveStatus(tally, observer) as live:
                service.run(seconds, status=live.refresh)
            waiting = pressure.share()
        finally:
            if worn is not None:
                worn_facts = worn.close()
            wearer.close()

    facts = tally.summary(service.latency, service.beats_skipped)
    late, due = camera.dropped.get(DropCause.LATE, 0), round(facts.seconds * TOPICS["ground"].rate_hz)
    void = Burden(waiting=waiting, frames=due, frames_late=late).too_much
    scores = observer.scoreboard.summary()
    summary_tables(facts)
    label = "perfect calibration" if perfect_calibration else "calibration with its stated residual"
    show(score_table(f"Ground against truth: {walk.name}, unit {seed}, {label}", scores))
    if worn is not None:
        tell_prosthesis(worn_facts, facts.health.ankle_states if facts.health is not None else 0)
    if void:
        console.print(f"These figures are void, the host was too busy: {void}.", style="bold", soft_wrap=True)
    if json is not None:
        run_facts = {
            "seed": seed,
            "scenario": walk.name,
            "calibration": label,
            "void": void,
            "run": facts,
            "ground": scores,
        }
        if worn_facts is not None:
            run_facts["prosthesis"] = worn_facts
        write_json(json, run_facts)
    if recorder is not None and record is not None:
        tell_recording(recorder, record)
    if void:
        raise typer.Exit(VOID)


_LEAD_NS = 2_000_000_000
"""The wearer's clock starts this much later: by then the renderer's process is up."""
