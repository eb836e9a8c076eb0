"""Systems of other people as a user would explain them: the drive EMPS, the cascaded tanks, a powered ankle's actuator.

    python -m benchmarks.own_systems [--system emps] [--out DIR]

The data are read where they are and left there. Everything is fitted on the estimation file alone; of a log of the
actuator on the first 60 %.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import gaiteyes
from lab.evaluation.measured.cascaded_tanks import tanks
from lab.evaluation.measured.data_folder import data_folder
from lab.evaluation.measured.emps import emps, residual_force

_FITTED = 0.6
"""Of a log of the actuator."""
_MOST_TORQUE_NM = 25.0
"""More than an AK80-9 gives in any moment."""

GEAR = gaiteyes.Port("gear", "N m", "the gear", (gaiteyes.Signal("speed", "rad/s", "velocity"),))


def actuator(table: gaiteyes.Table) -> gaiteyes.PortedSimulation:
    """Return what a torque sensor reads at a drive, from the torque that the drive claims: a gain, nothing else."""

    def torque(inputs: gaiteyes.Rows, values: gaiteyes.Arrays, act: gaiteyes.Act) -> tuple[gaiteyes.FloatArray]:
        claim, speed = inputs
        return (values["gain"] * claim + act("gear", speed),)

    channels = table.channels(
        ["adc_measured_torque"],
        ["motor_measured_torque", "motor_measured_speed"],
        time="loop_time",
        possible={"motor_measured_torque": (-_MOST_TORQUE_NM, _MOST_TORQUE_NM)},
    )
    gain = gaiteyes.Parameter("gain", "1", neutral=-1.0, low=-3.0, high=3.0, scale=0.001)
    return gaiteyes.PortedSimulation("ankle_actuator", channels, gaiteyes.Whole(torque), (GEAR,), (gain,))


Pair = tuple[gaiteyes.PortedSimulation, gaiteyes.PortedSimulation]


def _emps(folder: Path) -> Pair:
    return emps(folder / "estimation.csv.gz"), emps(folder / "validation.csv.gz")


def _tanks(folder: Path) -> Pair:
    path = folder / "dataBenchmark.csv.gz"
    return tanks(path, "Est"), tanks(path, "Val")


def _log(name: str) -> Callable[[Path], Pair]:
    def pair(folder: Path) -> Pair:
        table = gaiteyes.Table.load(folder / f"{name}.csv.gz")
        n = len(table["loop_time"])
        cut = round(_FITTED * n)
        return actuator(table.rows(0, cut)), actuator(table.rows(cut, n))

    return pair


SYSTEMS: dict[str, tuple[str, Callable[[Path], Pair], float, str]] = {
    "emps": ("sysid_emps", _emps, 1e3, "mm"),
    "cascaded_tanks": ("sysid_cascaded_tanks", _tanks, 1.0, "V"),
    **{
        f"actuator_{name}": ("tmotor_ankle_actuator", _log(log), 1.0, "N m")
        for name, log in (
            ("test_2", "SysID__system_id_test_2"),
            ("trial_5", "sys_ID_final__trial5"),
            ("trial_1", "sys_ID_final__trial1"),
            ("trial_3", "sys_ID_final__trial3"),
        )
    },
}


def told(name: str, data: Path, pair: Pair, per_unit: float, unit: str, out: Path | None) -> None:
    begun = time.process_time()
    explanation = gaiteyes.explain(*pair, seed=1)
    took_s = time.process_time() - begun
    verdict = explanation.verdict
    print(f"{name}: {gaiteyes.headline(verdict)}")
    for cause in verdict.causes:
        for parameter, quantity in cause.parameters.items():
            value, interval, shown = gaiteyes.quantity_text(quantity)
            print(f"  {cause.name}.{parameter} = {value} ({interval}) {shown}")
        if cause.equivalents:
            print(f"  look-alikes: {', '.join(cause.equivalents)}")
    for name_, quantity in verdict.parameters_after.items():
        print(f"  {name_} = {gaiteyes.quantity_text(quantity)[0]} {gaiteyes.quantity_text(quantity)[2]}")
    count = len(verdict.parameters_after) + sum(len(cause.parameters) for cause in verdict.causes)
    for which, view in (("estimation", explanation.fit), ("validation", explanation.held_out)):
        measured = view.channels.values
        before, after = (
            per_unit * float(np.sqrt(np.nanmean((measured - each) ** 2))) for each in (view.base, view.extended)
        )
        print(f"  {which}: {before:.3g} → {after:.3g} {unit} RMS, all samples")
    for note in explanation.notes:
        print(f"  note: {note}")
    print(f"  {count} parameters, {took_s:.0f} s of CPU")
    if name == "emps":
        path = data / "validation.csv.gz"
        sides = (explanation.values_before, explanation.values_after)
        before, after = (residual_force(path, pair[0], dict(values)) for values in sides)
        print(f"  residual force of the validation: {before:.3g} → {after:.3g} N RMS, {100.0 * after / before:.0f} %")
    if out is not None:
        gaiteyes.write_report(explanation, out / name)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--system", choices=sorted(SYSTEMS), default=None)
    parser.add_argument("--out", type=Path, default=None)
    options = parser.parse_args()
    for name, (folder, pair, per_unit, unit) in SYSTEMS.items():
        if options.system in (None, name):
            try:
                data = data_folder(folder)
                simulations = pair(data)
            except gaiteyes.UserError as error:
                print(f"{name}: not explained: {error}")
                continue
            told(name, data, simulations, per_unit, unit, options.out)


if __name__ == "__main__":
    main()
