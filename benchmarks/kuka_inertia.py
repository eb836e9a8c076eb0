"""A real seven-joint arm, identified on a part of its motion, predicted on the rest: `python -m
benchmarks.kuka_inertia`.
"""

from impedance.body.physical import boundary, is_consistent
from lab.evaluation.measured.data_folder import data_folder
from lab.evaluation.measured.kuka import (
    JOINTS,
    LINK_PARAMETERS,
    columns,
    identified,
    judged,
    read_arm,
    read_run,
    splits,
    told,
)


def main() -> None:
    folder = data_folder("kuka_lwr4_excitation")
    joints, run = read_arm(folder / "kuka_lwr4.urdf"), read_run(folder / "measurements_1.npz")
    Y, prior = columns(joints, run), told(joints)
    print(f"a-priori model, whole run: relative residual {100 * judged(Y, run.torque, prior).relative:.2f} %")
    for name, chosen in splits(len(run.q)).items():
        vector = identified(Y[chosen], run.torque[chosen], prior)
        seen, unseen = (judged(Y[part], run.torque[part], vector) for part in (chosen, ~chosen))
        links = vector[: LINK_PARAMETERS * JOINTS].reshape(JOINTS, LINK_PARAMETERS)
        by_joint = " ".join(f"{each:.2f}" for each in unseen.rms_nm)
        limits = sum(boundary(link) is not None for link in links)
        print(
            f"fitted on {name}: residual {100 * seen.relative:.2f} %; held out {100 * unseen.relative:.2f} %, NRMS "
            f"{100 * unseen.nrms:.3f} % of the range, by joint {by_joint} N·m; "
            f"all links consistent: {is_consistent(links)}, {limits} at their limit"
        )


if __name__ == "__main__":
    main()
