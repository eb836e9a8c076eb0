"""Prints the ground and the path ahead as GaitEyes sends them on CAN, and counts what must not be acted upon."""

import argparse
from math import degrees

import gaiteyes

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("--can", default="slcan:socket://127.0.0.1:29536", help="as socketcan:can0, slcan:/dev/ttyACM0")
arguments.add_argument("--accept-simulated", action="store_true")
options, kinds = arguments.parse_args(), (gaiteyes.ReceivedGround, gaiteyes.ReceivedTerrain)
waits = 50  # before anything is heard
try:
    with gaiteyes.listen_can(options.can, *kinds, accept_simulated=options.accept_simulated, timeout_s=0.2) as bus:
        while waits:
            for found in bus:
                waits, source, age = -1, found.source.value, f"age {found.age_s:.3f} s"
                if isinstance(found, gaiteyes.ReceivedGround):
                    slope, sd = degrees(found.slope_sagittal_rad), degrees(found.slope_sagittal_sd_rad)
                    height = f"height {found.height_m:.3f} ± {found.height_sd_m:.3f} m"
                    print(f"ground {source} slope {slope:+.1f} ± {sd:.1f}° {height} {age}", flush=True)
                elif isinstance(found, gaiteyes.ReceivedTerrain):
                    edge = found.edge and f"edge {found.edge.rise_m:+.3f} m in {found.edge.distance_m:.2f} m"
                    print("terrain", source, found.kind.value, edge or "no edge", age, flush=True)
            waits -= waits > 0 and not bus.refused
            if waits < 0 or bus.refused:
                print("silence, refused", {why.value: n for why, n in bus.refused.items()}, bus.reason, flush=True)
        raise gaiteyes.UserError(f"CAN {options.can}: nothing is heard")
except gaiteyes.UserError as error:
    arguments.exit(2, f"{error}; is `gaiteyes run` or `gaiteyes demo` running?\n")
