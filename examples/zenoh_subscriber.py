"""Prints the ground ahead as GaitEyes publishes it on Zenoh, and counts what must not be acted upon."""

import argparse
from math import degrees

import gaiteyes

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("--connect", help="tls/HOST:PORT; by default the service of this machine")
arguments.add_argument("--authority", default="", help="with TLS: the PEM file of who signed its certificate")
arguments.add_argument("--device", default="demo")
arguments.add_argument("--accept-simulated", action="store_true")
options = arguments.parse_args()
device, trusted, waits = options.device, gaiteyes.Credentials(authority=options.authority), 50
how = {"connect": options.connect, "credentials": trusted, "accept_simulated": options.accept_simulated}
try:
    with gaiteyes.listen(gaiteyes.GroundPlane, device, **how, timeout_s=0.2) as listener:
        while waits:  # so many before anything is heard, then for ever
            for received in listener:
                waits, ground, stamp = -1, received.message, received.stamp
                slope, height = f"slope {degrees(ground.slope_sagittal_rad):+.1f}°", f"height {ground.height_m:.3f} m"
                print(stamp.source.value, ground.status.value, ground.reason.value, slope, height, end=" ")
                print(f"age {received.age_s:.3f} s, lost {received.lost_before}", flush=True)
            waits -= waits > 0 and not listener.refused
            if waits < 0 or listener.refused:
                print("silence, refused", {why.value: n for why, n in listener.refused.items()}, flush=True)
        raise gaiteyes.UserError(f"Zenoh: '{device}' is silent; is `gaiteyes run` or `gaiteyes demo` running?")
except gaiteyes.UserError as error:
    arguments.exit(2, f"{error}\n")
