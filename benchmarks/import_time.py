"""How long imports take, each in a fresh interpreter: `python -m benchmarks.import_time`.

The median of several runs, in milliseconds beyond the bare interpreter, and as a ratio to `import numpy`, which says
the same on a slow or busy machine.
"""

import argparse
import statistics
import subprocess
import sys
import time

REFERENCE = "import numpy"
HELP = "import sys; sys.argv = ['gaiteyes', '--help']; from cli.main import main; main()"
STATEMENTS = (
    REFERENCE,
    "import gaiteyes",
    "import gaiteyes; gaiteyes.GroundPlane",
    "import gaiteyes; gaiteyes.listen",
    "import gaiteyes; gaiteyes.OwnSimulation",
    "import gaiteyes; gaiteyes.explain",
    "import gaiteyes; gaiteyes.Pipeline",
    "import gaiteyes; gaiteyes.replay",
    "import cli.main",
    HELP,
)


def median_s(statement: str, runs: int) -> float:
    """Return the median time of an interpreter that runs `statement`, and the interpreter's own start in it."""
    took_s = []
    for _ in range(runs):
        start_s = time.perf_counter()
        subprocess.run([sys.executable, "-c", statement], stdout=subprocess.DEVNULL, check=True)
        took_s.append(time.perf_counter() - start_s)
    return statistics.median(took_s)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--runs", type=int, default=7)
    runs = arguments.parse_args().runs
    for statement in STATEMENTS:  # once for the disk's cache and the compiled files
        median_s(statement, 1)
    bare_s = median_s("pass", runs)
    took_s = {statement: median_s(statement, runs) - bare_s for statement in STATEMENTS}
    print("| statement | ms | of `import numpy` |\n| --- | --- | --- |")
    for statement, each_s in took_s.items():
        shown = "gaiteyes --help" if statement is HELP else statement
        print(f"| `{shown}` | {1e3 * each_s:.0f} | {each_s / took_s[REFERENCE]:.2f} |")


if __name__ == "__main__":
    main()
