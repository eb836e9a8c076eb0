"""Prints the ground and the path ahead as GaitEyes sends them on CAN, and counts what must not be acted upon."""

import argparse

import gaiteyes

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("--interface", default="slcan", help="of python-can: slcan, socketcan, udp_multicast")
arguments.add_argument("--channel", default="socket://127.0.0.1:29536", help="as /dev/ttyACM0, can0, 239.74.163.2")
arguments.add_argument("--accept-simulated", action="store_true")
options = arguments.parse_args()
bus, kinds = f"{options.interface}:{options.channel}", (gaiteyes.ReceivedGround, gaiteyes.ReceivedTerrain)
try:
    listener = gaiteyes.listen_can(bus, *kinds, accept_simulated=options.accept_simulated, timeout_s=0.2)
except gaiteyes.UserError as error:
    arguments.exit(2, f"{error}\n")
with listener:
    while True:
        for found in listener:
            source, age = found.source.value, f"age {found.age_s:.3f} s"
            if isinstance(found, gaiteyes.ReceivedGround):
                slope = f"slope {found.slope_sagittal_rad:.3f} ± {found.slope_sagittal_sd_rad:.3f} rad"
                height = f"height {found.height_m:.3f} ± {found.height_sd_m:.3f} m"
                print("ground", source, slope, height, age, flush=True)
            elif isinstance(found, gaiteyes.ReceivedTerrain):
                edge = found.edge and f"edge {found.edge.rise_m:+.3f} m in {found.edge.distance_m:.2f} m"
                print("terrain", source, found.kind.value, edge or "no edge", age, flush=True)
        refused = {why.value: count for why, count in listener.refused.items()}
        print("silence, refused", refused, listener.reason, flush=True)
