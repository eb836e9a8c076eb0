"""Prints the ground ahead as GaitEyes sends it on CAN, and counts what must not be acted upon."""

import argparse

import gaiteyes

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("--interface", default="slcan", help="of python-can: slcan, socketcan, udp_multicast")
arguments.add_argument("--channel", default="socket://127.0.0.1:29536", help="as /dev/ttyACM0, can0, 239.74.163.2")
arguments.add_argument("--accept-simulated", action="store_true")
options = arguments.parse_args()
try:
    listener = gaiteyes.listen_can(
        f"{options.interface}:{options.channel}", accept_simulated=options.accept_simulated, timeout_s=0.2
    )
except gaiteyes.UserError as error:
    arguments.exit(2, f"{error}\n")
with listener:
    while True:
        for ground in listener:
            slope = f"slope {ground.slope_sagittal_rad:.3f} ± {ground.slope_sagittal_sd_rad:.3f} rad"
            height = f"height {ground.height_m:.3f} ± {ground.height_sd_m:.3f} m"
            print("ground", ground.source.value, slope, height, f"age {ground.age_s:.3f} s", flush=True)
        refused = {why.value: count for why, count in listener.refused.items()}
        print("silence, refused", refused, listener.reason, flush=True)
