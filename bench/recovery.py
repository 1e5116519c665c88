"""How soon a server answers again that was killed while it learned.

    python3 -m venv .venv && .venv/bin/pip install numpy
    cargo build --release
    .venv/bin/python bench/recovery.py

Stores a million steps (5,000 events of 200), lets a version serve, begins a task, and kills the process (SIGKILL) while it
runs, `--kills` times. Timed is from the start of the next process to its first prediction, and to the task running again.
"""

import argparse
import pathlib
import signal
import statistics
import tempfile
import time

from growth import Server, json_events

MODEL = "/v1/models/default"
WINDOW = {"follower_speed_mps": [14.0] * 10, "leader_speed_mps": [14.0] * 10, "spacing_m": [20.0] * 10}


def running(server, task):
    """The task, once it is under way."""
    while True:
        now = server.call("GET", f"{MODEL}/tasks/{task}")
        if now["state"] == "running" and now["progress"] > 0:
            return now
        if now["state"] not in ("queued", "running"):
            raise SystemExit(now)


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--events", type=int, default=5000)
    cli.add_argument("--steps", type=int, default=200)
    cli.add_argument("--kills", type=int, default=3, help="more from one checkpoint would end the task (training.max_crashes)")
    cli.add_argument("--binary", default="target/release/headway")
    args = cli.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        database = pathlib.Path(folder, "headway.db")
        server = Server(args.binary, database)
        server.learn("default", "fast", json_events(0, 60, 40))
        for first in range(100, 100 + args.events, 500):
            events = {"events": json_events(first, min(500, 100 + args.events - first), args.steps, split="train")}
            server.call("POST", f"{MODEL}/batches?regime=slow", events)
        task = server.call("POST", f"{MODEL}/tasks", {"batches": "pending", "settings": {"epochs": 50}})["task_id"]
        answered, resumed = [], []
        for _ in range(args.kills):
            running(server, task)
            server.stop(signal.SIGKILL)
            began = time.perf_counter()
            server = Server(args.binary, database)
            server.call("POST", f"{MODEL}/predict", {"windows": [WINDOW]})
            answered.append(time.perf_counter() - began)
            running(server, task)
            resumed.append(time.perf_counter() - began)
        server.stop(signal.SIGKILL)
    print(f"{args.events * args.steps:,} steps stored, a task running, {args.kills} kills:")
    for name, seconds in (("first prediction", answered), ("the task runs again", resumed)):
        print(f"{name}: median {1e3 * statistics.median(seconds):.0f} ms, longest {1e3 * max(seconds):.0f} ms")


if __name__ == "__main__":
    main()
