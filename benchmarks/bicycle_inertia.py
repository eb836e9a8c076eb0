"""Real inertias by pendulum beside the published values: `python -m benchmarks.bicycle_inertia`."""

from impedance.body.pendulum import centre_of_pairs
from lab.evaluation.measured.bicycle import BICYCLES, compared, raw_period
from lab.evaluation.measured.data_folder import data_folder


def main() -> None:
    folder = data_folder("bicycle_pendulum_inertia")
    for name in BICYCLES:
        print(
            f"{name}: ours by least squares, published (± one standard deviation), difference in published deviations;"
        )
        print("  last the same difference with the published way to the centre of mass, the mean of all line crossings")
        for row, likewise in zip(compared(folder, name), compared(folder, name, centre_of_pairs), strict=True):
            print(
                f"  {row.name:5s} {row.ours:9.5f} ± {row.our_deviation:.5f}   "
                f"{row.published:9.5f} ± {row.published_deviation:.5f}   {row.off:+.2f}   {likewise.off:+.2f}"
            )
    period_s, deviation_s = raw_period(folder)
    print(f"raw rate gyro of the Browserins fork: period {period_s:.6f} ± {deviation_s:.6f} s")


if __name__ == "__main__":
    main()
