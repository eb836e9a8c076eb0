"""Prints the ground ahead as GaitEyes publishes it on Zenoh, and refuses what must not be acted upon."""

import argparse
import json
import time
from pathlib import Path

import zenoh

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("--connect", default="tcp/127.0.0.1:7447")
arguments.add_argument("--device", default="demo")
arguments.add_argument("--accept-simulated", action="store_true")
options = arguments.parse_args()
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [options.connect]}}))
config.insert_json5("scouting/multicast/enabled", "false")
this_boot, boot_id, seq = Path("/proc/sys/kernel/random/boot_id").read_text().strip(), None, 0
with zenoh.open(config) as session, session.declare_subscriber(f"gaiteyes/{options.device}/ground/v1") as ground:
    for sample in ground:
        m = json.loads(sample.payload.to_bytes())
        lost = max(0, m["seq"] - seq - 1) if m["boot_id"] == boot_id else 0  # a new boot or service counts anew
        boot_id, seq = m["boot_id"], m["seq"]
        # The two clocks are one only on the same machine; from elsewhere the way here adds to the age unseen.
        age = m["age_s"] + (1e-9 * (time.monotonic_ns() - m["t_publish_ns"]) if boot_id == this_boot else 0.0)
        allowed = m["source"] == "live" or options.accept_simulated
        word = "ground" if allowed and m["status"] == "valid" and age < 0.1 else "refused"
        numbers = f"slope {m['slope_sagittal_rad']} rad, height {m['height_m']} m, age {age:.3f} s, lost {lost}"
        print(word, m["source"], m["status"], m["reason"], numbers, flush=True)
