"""Headway beside FastAPI and ONNX Runtime over HTTP: the same network, the same JSON, the same load, in one run.

    python3 -m venv .venv && .venv/bin/pip install fastapi uvicorn uvloop httptools orjson onnxruntime onnx numpy
    cargo build --release && cargo install oha && apt-get install wrk
    .venv/bin/python bench/serving.py

Each server runs alone on this machine, beside its load: `bench/fastapi_server.py` with two workers, then Headway, which first
learns one small task with the settings of the paper (128 hidden units, horizon 10), so that both compute the same.

- peak: `wrk -t1 -c64` posts one window a request; the median of `--repeats` runs by rate.
- constant rate: `oha -q RATE --latency-correction`, whose latencies count from the moment a request was due. Half of a
  server's own peak (or `--rate`), and, for Headway, a quarter of it without and with a task that trains on one core.
- 1,000 windows a request: `wrk -t1 -c4`.
- resident memory of Headway before it was asked anything, with one model live.

Prints a Markdown table; `--out` (default serving.json) gets every figure and the conditions. `--only headway` or
`--only fastapi` runs one of them.
"""

import argparse
import contextlib
import json
import math
import os
import pathlib
import platform
import random
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

HERE = pathlib.Path(__file__).parent
HORIZON, HIDDEN, STEPS = 10, 128, 150

LUA = """
local file = io.open(os.getenv("BODY"), "rb")
wrk.method, wrk.body = "POST", file:read("*a")
wrk.headers["Content-Type"] = "application/json"
file:close()
done = function(summary, latency)
  local e = summary.errors
  io.write(string.format('\\n{"requests_per_s": %f, "p50_ms": %f, "p99_ms": %f, "max_ms": %f, "errors": %d}\\n',
    summary.requests / summary.duration * 1e6, latency:percentile(50) / 1e3, latency:percentile(99) / 1e3,
    latency.max / 1e3, e.connect + e.read + e.write + e.status + e.timeout))
end
"""


def call(url, body=None):
    """What a call with JSON answers."""
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url, data, {"Content-Type": "application/json"})
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)


def event(number):
    """A follower that lags behind a leader on a wave."""
    speed, phase = 8 + 8 * (number % 7) / 7, 0.7 * number
    wave = lambda step, phase: speed + 2 * math.sin(0.05 * step + phase)
    leader, follower = ([wave(step, p) for step in range(STEPS)] for p in (phase, phase - 0.6))
    spacing = [12 + speed + number % 3]
    for t in range(1, STEPS):
        spacing.append(spacing[-1] + 0.05 * (leader[t - 1] + leader[t] - follower[t - 1] - follower[t]))
    return {"event_id": f"e{number}", "dt_s": 0.1, "spacing_m": spacing, "follower_speed_mps": follower,
            "leader_speed_mps": leader}


def windows(count):
    """A request of so many windows, of ordinary numbers with three decimals."""
    rng = random.Random(1)
    near = lambda value: [round(value + rng.uniform(-0.5, 0.5), 3) for _ in range(HORIZON)]
    return {"windows": [{"follower_speed_mps": near(12), "leader_speed_mps": near(12), "spacing_m": near(20)}
                        for _ in range(count)]}


class Load:
    """The load generators, and the bodies they send."""

    def __init__(self, args, folder):
        self.args, self.folder = args, folder
        (folder / "post.lua").write_text(LUA)
        for count in (1, 1000):
            (folder / f"{count}.json").write_text(json.dumps(windows(count)))

    def peak(self, url, windows=1, connections=64):
        """The median run by rate."""
        def once(seconds):
            command = ["wrk", "-t1", f"-c{connections}", f"-d{seconds}s", "-s", str(self.folder / "post.lua"), url]
            environment = os.environ | {"BODY": str(self.folder / f"{windows}.json")}
            answer = subprocess.run(command, stdout=subprocess.PIPE, env=environment, check=True, text=True).stdout
            return json.loads(answer.splitlines()[-1])
        once(2)
        runs = sorted((once(self.args.seconds) for _ in range(self.args.repeats)), key=lambda run: run["requests_per_s"])
        return runs[len(runs) // 2] | {"all_requests_per_s": [run["requests_per_s"] for run in runs]}

    def constant(self, url, rate):
        """Latencies of requests that are due at a constant rate."""
        def once(seconds):
            command = [self.args.oha, "--no-tui", "--output-format", "json", "-z", f"{seconds}s", "-q", str(rate), "-c", "64",
                       "--latency-correction", "-m", "POST", "-T", "application/json", "-D", str(self.folder / "1.json"), url]
            told = json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True).stdout)
            good = told["statusCodeDistribution"].get("200", 0)
            return {"rate": rate, "requests_per_s": told["summary"]["requestsPerSec"],
                    "p50_ms": 1e3 * told["latencyPercentiles"]["p50"], "p99_ms": 1e3 * told["latencyPercentiles"]["p99"],
                    "errors": sum(told["statusCodeDistribution"].values()) - good}
        runs = sorted((once(self.args.seconds) for _ in range(self.args.repeats)), key=lambda run: run["p99_ms"])
        return runs[len(runs) // 2] | {"all_p99_ms": [run["p99_ms"] for run in runs]}


@contextlib.contextmanager
def started(command, url, **options):
    """A process that answers at `url`, ended afterwards."""
    process = subprocess.Popen(command, **options)
    try:
        for _ in range(200):
            with contextlib.suppress(urllib.error.HTTPError, OSError):
                urllib.request.urlopen(url).close()
                break
            time.sleep(0.1)
        else:
            raise SystemExit(f"{command[0]} does not answer at {url}")
        yield process
    finally:
        process.terminate()
        process.wait()


def fastapi(args, load, folder):
    import onnx_model
    (folder / "model.onnx").write_bytes(onnx_model.Network(HIDDEN).graph("operator"))
    command = [sys.executable, str(HERE / "fastapi_server.py"), "--model", str(folder / "model.onnx"), "--port", str(args.port)]
    base = f"http://127.0.0.1:{args.port}"
    with started(command, f"{base}/openapi.json"):
        return common(args, load, f"{base}/predict")


def common(args, load, url):
    """What is measured of both."""
    call(url, windows(1))
    peak = load.peak(url)
    half = args.rate or round(peak["requests_per_s"] / 2)
    return {"peak": peak, "half": load.constant(url, half), "thousand": load.peak(url, windows=1000, connections=4)}


def resident_mb(process):
    status = pathlib.Path(f"/proc/{process.pid}/status").read_text()
    return next(int(line.split()[1]) / 1024 for line in status.splitlines() if line.startswith("VmRSS"))


def task(base, model, events, epochs):
    """Uploads events and asks for a task that learns them."""
    call(f"{base}/v1/models", {"model": model, "method": "naive", "settings":
                               {"preset": "paper", "epochs": epochs, "schedule": "manual", "promotion": "auto"}})
    call(f"{base}/v1/models/{model}/batches", {"events": [event(number) for number in range(events)]})
    return f"{base}/v1/models/{model}/tasks/" + call(f"{base}/v1/models/{model}/tasks", {"batches": "pending"})["task_id"]


def headway(args, load, folder):
    base = f"http://127.0.0.1:{args.port + 1}"
    command = [args.binary, "serve", "--listen", base.removeprefix("http://"), "--database", str(folder / "headway.db"),
               "--set", "training.training_threads=1"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    url = f"{base}/v1/models/served/predict"
    with started(command, f"{base}/readyz", **quiet):
        learned = call(task(base, "served", 60, 1) + "?wait_s=60")
        if learned["state"] != "succeeded":
            raise SystemExit(f"the task {learned['state']}: {learned['error']}")
    with started(command, f"{base}/readyz", **quiet) as process:
        time.sleep(1)
        told = {"idle_resident_mb": resident_mb(process)} | common(args, load, url)
        quarter = round(told["peak"]["requests_per_s"] / 4)
        told["quarter"] = load.constant(url, quarter)
        training = task(base, "training", 400, 1000)
        while call(training)["state"] == "queued" or not call(training)["progress"]:
            time.sleep(0.2)
        told["quarter_training"] = load.constant(url, quarter)
        if call(training)["state"] != "running":
            raise SystemExit("the task ended before the measurement did")
        call(f"{training}/cancel", {})
        return told


def rows(ours, theirs):
    """Figure, FastAPI's, Headway's, ratio."""
    latency = lambda told: f"{told['p99_ms']:.2f} ms at {told['requests_per_s']:,.0f}/s"
    both = ours and theirs
    over = lambda name: f"{ours[name]['requests_per_s'] / theirs[name]['requests_per_s']:.1f} ×" if both else "–"
    each = lambda show: [show(side) if side else "–" for side in (theirs, ours)]
    yield ["one window a request, 64 connections, requests/s", *each(lambda s: f"{s['peak']['requests_per_s']:,.0f}"), over("peak")]
    yield ["p99 then", *each(lambda s: f"{s['peak']['p99_ms']:.1f} ms"), "–"]
    yield ["p99 at half of its peak, constant rate", *each(lambda s: latency(s["half"])), "–"]
    yield ["1,000 windows a request, 4 connections, windows/s",
           *each(lambda s: f"{1000 * s['thousand']['requests_per_s']:,.0f}"), over("thousand")]
    if ours:
        idle, busy = ours["quarter"], ours["quarter_training"]
        yield ["p99 at a quarter of its peak, constant rate", "–", latency(idle), "–"]
        yield ["the same while a task trains on one core", "–", latency(busy), f"{busy['p99_ms'] / idle['p99_ms']:.1f} × the idle"]
        yield ["resident memory of the idle server", "–", f"{ours['idle_resident_mb']:.0f} MB", "–"]


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--binary", default="target/release/headway")
    cli.add_argument("--oha", default="oha")
    cli.add_argument("--port", type=int, default=8101, help="of FastAPI; Headway takes the next")
    cli.add_argument("--seconds", type=int, default=10, help="of each run")
    cli.add_argument("--repeats", type=int, default=3)
    cli.add_argument("--rate", type=int, help="instead of half of the peak, requests/s")
    cli.add_argument("--only", choices=["fastapi", "headway"])
    cli.add_argument("--out", type=pathlib.Path, default=pathlib.Path("serving.json"))
    args = cli.parse_args()
    sides = {}
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        load = Load(args, folder)
        for name, measure in (("fastapi", fastapi), ("headway", headway)):
            if args.only in (None, name):
                sides[name] = measure(args, load, folder)
    print(f"| figure | FastAPI + ONNX Runtime | Headway | ratio |\n{'| --- ' * 4}|")
    for row in rows(sides.get("headway"), sides.get("fastapi")):
        print("| " + " | ".join(row) + " |")
    conditions = {"cpus": os.cpu_count(), "machine": platform.machine(), "python": platform.python_version(),
                  "seconds": args.seconds, "repeats": args.repeats, "hidden": HIDDEN, "horizon": HORIZON}
    args.out.write_text(json.dumps(sides | {"conditions": conditions}, indent=1) + "\n")


if __name__ == "__main__":
    main()
