"""How long a newcomer waits for the first plane in a browser: `python -m docs.measure_first_plane [--clone FOLDER]`.

`gaiteyes demo` and `gaiteyes view` are started as a person does, one after the other, and a headless Chromium opens the
address that is printed; the time ends when the page has drawn a picture and says a slope. With --clone, the project is
cloned into FOLDER and its environment made there first (`make .venv/.installed`, with whatever package mirror pip is
set up for), and all of that is counted. Each part is printed.
"""

import argparse
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

from drivers.picture_socket import devices_here
from tests.bench.browser import browser, chromium

PROJECT = Path(__file__).parents[1]
PLANE = (
    "Number(document.getElementById('picture').dataset.drawn) > 0 && "
    "/°/.test(document.getElementById('ground').textContent)"
)
PATIENCE_S = 120.0


def cloned(folder: Path) -> Path:
    """Clone the project, make its environment, and return the command."""
    subprocess.run(["git", "clone", "--quiet", PROJECT, folder], check=True)
    told("cloned")
    subprocess.run(["make", "-s", "-C", folder, ".venv/.installed"], check=True, stdout=subprocess.DEVNULL)
    told("environment made")
    return folder / ".venv" / "bin" / "gaiteyes"


def first_plane(command: Path, program: str) -> None:
    """Start the demo and the view, and wait for the plane."""
    if devices_here():
        sys.exit(f"a service runs here already: {', '.join(devices_here())}")
    demo = subprocess.Popen([command, "demo", "--seconds", "600"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    view = None
    try:
        end_s = time.monotonic() + PATIENCE_S
        while not devices_here():
            if demo.poll() is not None or time.monotonic() > end_s:
                sys.exit("`gaiteyes demo` did not start")
            time.sleep(0.1)
        told("the service runs")
        view = subprocess.Popen([command, "view", "--port", "0"], stdout=subprocess.PIPE, text=True)
        assert view.stdout is not None
        url = view.stdout.readline().split()[-1]
        told("the page is served")
        with browser(program) as page:
            page.open(url)
            try:
                page.wait_until(PLANE)
            except AssertionError:
                sys.exit(f"no plane within two minutes; the page says: {page.evaluate('document.body.innerText')}")
            told("first plane in the browser")
    finally:
        for process in (view, demo):
            if process is not None:
                process.terminate()
                with suppress(subprocess.TimeoutExpired):
                    process.wait(20.0)
                process.kill()


def told(what: str) -> None:
    """Print what is done, and after how long."""
    print(f"{time.monotonic() - BEGUN_S:6.1f} s  {what}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--clone", type=Path, help="folder that is not there yet")
    options = parser.parse_args()
    found = chromium()
    if found is None:
        sys.exit("no Chromium on this machine: apt install chromium")
    BEGUN_S = time.monotonic()
    gaiteyes = Path(sys.executable).with_name("gaiteyes") if options.clone is None else cloned(options.clone)
    first_plane(gaiteyes, found)
