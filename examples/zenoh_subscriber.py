"""Prints the ground ahead as GaitEyes publishes it on Zenoh, and counts what must not be acted upon."""

import argparse

import gaiteyes

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("--connect", help="tls/HOST:PORT; by default the service of this machine")
arguments.add_argument("--authority", default="", help="with TLS: the PEM file of who signed its certificate")
arguments.add_argument("--device", default="demo")
arguments.add_argument("--accept-simulated", action="store_true")
options = arguments.parse_args()
try:
    listener = gaiteyes.listen(
        gaiteyes.GroundPlane,
        options.device,
        connect=options.connect,
        credentials=gaiteyes.Credentials(authority=options.authority),
        accept_simulated=options.accept_simulated,
        timeout_s=0.2,
    )
except gaiteyes.UserError as error:
    arguments.exit(2, f"{error}\n")
with listener:
    while True:
        for received in listener:
            ground, age = received.message, f"age {received.age_s:.3f} s, lost {received.lost_before}"
            slope, height = f"slope {ground.slope_sagittal_rad:.3f} rad", f"height {ground.height_m:.3f} m"
            print(received.stamp.source.value, ground.status.value, ground.reason.value, slope, height, age, flush=True)
        print("silence, refused", {why.value: count for why, count in listener.refused.items()}, flush=True)
