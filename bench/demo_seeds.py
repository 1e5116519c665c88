"""What the demo's models forget, for several seeds of generated traffic.

    cargo build --release
    python3 bench/demo_seeds.py

Runs `headway demo --exit --json` once per seed and prints a Markdown table of R[3,1]/R[1,1] (fast) and R[3,2]/R[2,2]
(middle) of both models, of what holding on cost (R[3,3] of ewc / of naive) and of the collisions. Exits with 1 unless on
every seed naive's error on fast traffic grew at least 1.5 times and ewc's at most 1.1 times.
"""

import argparse
import json
import subprocess
import sys
import time


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--seeds", default="42,43,44,45,46")
    cli.add_argument("--binary", default="target/release/headway")
    args, more = cli.parse_known_args()
    print("| seed | naive fast | naive middle | ewc fast | ewc middle | slow, ewc / naive | ewc collisions | s |")
    print("| --- " * 8 + "|")
    held = True
    for seed in args.seeds.split(","):
        command = [args.binary, "demo", "--exit", "--json", "--listen", "127.0.0.1:0", "--seed", seed, *more]
        began = time.perf_counter()
        story = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL).stdout)
        seconds = time.perf_counter() - began
        naive, ewc = story["models"]["naive"], story["models"]["ewc"]
        (naive_fast, naive_middle), (ewc_fast, ewc_middle) = naive["forgetting_ratio"], ewc["forgetting_ratio"]
        slow = ewc["spacing_mse"][2][2] / naive["spacing_mse"][2][2]
        collisions = max(rate for stage in ewc["collision_rate_percent"] for rate in stage if rate is not None)
        held = held and naive_fast >= 1.5 and ewc_fast <= 1.1
        print(f"| {seed} | {naive_fast:.2f} | {naive_middle:.2f} | {ewc_fast:.2f} | {ewc_middle:.2f} | {slow:.2f} "
              f"| {collisions:.1f} % | {seconds:.0f} |", flush=True)
    sys.exit(0 if held else "missed: naive at least 1.5 and ewc at most 1.1 on fast traffic")


if __name__ == "__main__":
    main()
