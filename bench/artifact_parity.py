"""Whether the files that a server hands out drive as its own predictions do.

    python3 -m venv .venv && .venv/bin/pip install onnxruntime numpy pyarrow safetensors torch
    cargo build
    HEADWAY_RECORDED_DATA=DIR .venv/bin/python bench/artifact_parity.py

Starts `--binary` on a free port with a database of its own, and lets a small model of every method learn three versions, and
one model of the paper's settings with 128 hidden units. Of every version it compares `raw_accel_mps2` of predict, on the same
`--windows` windows of recorded events, with the ONNX file run by onnxruntime and with the safetensors file loaded into
`torch.nn.LSTM`. Windows come from the Parquet files in HEADWAY_RECORDED_DATA (columns as FollowNet names them); with
`--synthetic` they are made up, and `--onnx-only` leaves torch out. Prints a table in Markdown; the exit code is 1 when a
difference exceeds 1e-5 of the acceleration limit.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import urllib.error
import urllib.request

import numpy as np
import onnxruntime

METHODS = ("naive", "joint", "ewc", "mas", "si", "replay", "replay_ewc", "replay_mas")
REGIMES = ("fast", "middle", "slow")
STEPS = 60
BOUND = 1e-5


def recorded(folder):
    """Follower speed, leader speed and spacing of every recorded event: a list of three rows each."""
    import pyarrow.parquet as pq

    events = []
    for path in sorted(pathlib.Path(folder).glob("*.parquet")):
        columns = ["event_id", "sv_speed", "lv_speed", "spacing"]
        if not set(columns) <= set(pq.read_schema(path).names):
            continue
        table = pq.read_table(path, columns=columns)
        ids = table["event_id"].to_numpy()
        begins = np.flatnonzero(np.append(True, ids[1:] != ids[:-1]))
        rows = np.stack([table[name].to_numpy().astype(np.float32) for name in columns[1:]])
        events += np.split(rows, begins[1:], axis=1)
    return [event for event in events if event.shape[1] >= STEPS]


def synthetic(random):
    """A leader on waves, a follower that lags behind it."""
    t = np.arange(STEPS) * 0.1

    def event():
        speed, phase = random.uniform(4, 20), random.uniform(0, 6)
        leader, follower = speed + np.sin(1.5 * t + phase), speed + np.sin(1.5 * t + phase - 0.6)
        return np.stack([follower, leader, 10 + speed + np.cumsum(0.1 * (leader - follower))]).astype(np.float32)

    return [event() for _ in range(200)]


def draw_windows(events, count, horizon, random):
    """[count, horizon, 4] as the artifacts take them."""
    chosen = []
    for at in random.integers(0, len(events), count):
        start = random.integers(0, events[at].shape[1] - horizon + 1)
        follower, leader, spacing = events[at][:, start:start + horizon]
        chosen.append(np.stack([follower, leader, leader - follower, spacing], 1))
    return np.stack(chosen)


class Server:
    """The real binary as a child process."""

    def __init__(self, binary, folder):
        command = [binary, "--listen", "127.0.0.1:0", "--database", os.path.join(folder, "headway.db"),
                   "--set", 'log.filter="warn"', "--set", 'model.schedule="manual"']
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.url = self.process.stdout.readline().split()[-1]

    def send(self, method, path, body=None):
        body = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.url + path, body, {"Content-Type": "application/json"}, method=method)
        try:
            with urllib.request.urlopen(request) as answer:
                return answer.read()
        except urllib.error.HTTPError as error:
            raise SystemExit(f"{method} {path}: {error.code} {error.read().decode()}") from None

    def call(self, method, path, body=None):
        return json.loads(self.send(method, path, body))

    def learn(self, model, regime, events):
        """Uploads events and learns them."""
        rows = [{"event_id": f"{regime}-{i}", "dt_s": 0.1, "split": "test" if i % 4 == 3 else "train",
                 "follower_speed_mps": event[0, :STEPS].tolist(), "leader_speed_mps": event[1, :STEPS].tolist(),
                 "spacing_m": event[2, :STEPS].tolist()} for i, event in enumerate(events)]
        receipt = self.call("POST", f"/v1/models/{model}/batches?regime={regime}", {"events": rows})
        task = self.call("POST", f"/v1/models/{model}/tasks", {"batches": [receipt["batch_id"]], "regime": regime})
        while task["state"] in ("queued", "running"):
            task = self.call("GET", f"/v1/models/{model}/tasks/{task['task_id']}?wait_s=60")
        if task["state"] != "succeeded":
            raise SystemExit(f"{model}, {regime}: {task['state']} {task['error']}")
        return task["version"]

    def predict(self, model, version, windows):
        rows = [{"follower_speed_mps": w[:, 0].tolist(), "leader_speed_mps": w[:, 1].tolist(),
                 "spacing_m": w[:, 3].tolist()} for w in windows]
        answer = self.call("POST", f"/v1/models/{model}/predict", {"version": version, "windows": rows})
        return np.array([p["raw_accel_mps2"] for p in answer["predictions"]])

    def artifact(self, model, version, kind):
        return self.send("GET", f"/v1/models/{model}/versions/{version}/artifact?format={kind}")


def by_onnx(file, windows):
    session = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])
    assert session.run(["raw_accel_mps2"], {"window": windows[:1]})[0].shape == (1, 1), "n is free"
    return session.run(["raw_accel_mps2"], {"window": windows})[0][:, 0]


def by_torch(file, windows):
    import torch
    from safetensors import safe_open
    from safetensors.torch import load

    with tempfile.NamedTemporaryFile() as kept:
        kept.write(file)
        kept.flush()
        with safe_open(kept.name, "pt") as opened:
            said = opened.metadata()
    tensors, settings, scaling = load(file), json.loads(said["settings"]), json.loads(said["scaling"])
    net = torch.nn.Module()
    net.lstm = torch.nn.LSTM(tensors["lstm.weight_ih_l0"].shape[1], settings["hidden"], batch_first=True)
    net.head = torch.nn.Linear(settings["hidden"], 1)
    net.load_state_dict({name: tensors[name] for name in net.state_dict()})
    x, mean, spread = windows, scaling["mean"], scaling["spread"]
    if settings["features"] == "motion":
        mean, spread = mean + scaling["motion"]["mean"], spread + scaling["motion"]["spread"]
        elapsed = np.arange(x.shape[1], dtype=np.float32)[:, None] * np.float32(settings["dt_s"])
        elapsed[0] = 1
        closing = x[..., 2:3] / (np.maximum(x[..., 3:4], 0) + np.float32(1))
        x = np.concatenate([x, (x[..., :2] - x[:, :1, :2]) / elapsed, closing], 2)
    with torch.no_grad():
        x = (torch.tensor(x) - torch.tensor(mean)) / torch.tensor(spread)
        _, (state, _) = net.lstm(x)
        return (settings["accel_limit_mps2"] * torch.tanh(net.head(state[0])))[:, 0].numpy()


def main():
    cli = argparse.ArgumentParser()
    cli.add_argument("--binary", default="target/debug/headway")
    cli.add_argument("--windows", type=int, default=10_000)
    cli.add_argument("--hidden", type=int, default=16)
    cli.add_argument("--events", type=int, default=12, help="of each regime")
    cli.add_argument("--models", help="only these, separated by commas")
    cli.add_argument("--synthetic", action="store_true")
    cli.add_argument("--onnx-only", action="store_true")
    args = cli.parse_args()
    random = np.random.default_rng(42)
    folder = os.environ.get("HEADWAY_RECORDED_DATA", "../shared/data")
    events = synthetic(random) if args.synthetic else recorded(folder)
    if not events:
        raise SystemExit(f"{folder} has no Parquet file of events: HEADWAY_RECORDED_DATA names another, --synthetic does without")
    events.sort(key=lambda event: -event[0, :STEPS].mean())
    # Further apart than a speed at which nobody drives.
    usable = [event for event in events if event[2, :STEPS].min() > 2]
    thirds = np.array_split(np.arange(len(usable)), len(REGIMES))
    regimes = [[usable[i] for i in random.choice(third, args.events, replace=False)] for third in thirds]
    # Far enough that accelerations are more than rounding.
    learning = {"epochs": 8, "minibatch": 4, "learning_rate": 0.01}
    models = [(method, method, {"hidden": args.hidden, **learning}) for method in METHODS]
    models.append(("paper-128", "ewc", {"preset": "paper", "epochs": 3, "minibatch": 4}))
    models = [model for model in models if args.models is None or model[0] in args.models.split(",")]
    worst = 0.0
    print("| model | version | weights | inputs | accelerations, m/s² | ONNX, of the limit | safetensors in torch, of the limit |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        server = Server(args.binary, folder)
        try:
            for model, method, settings in models:
                made = server.call("POST", "/v1/models", {"model": model, "method": method, "settings": settings})
                windows = draw_windows(events, args.windows, made["settings"]["horizon"], random)
                limit = made["settings"]["accel_limit_mps2"]
                order = list(zip(REGIMES, regimes))
                # Each would diverge the other way round, with so few events.
                for regime, chosen in reversed(order) if model == "paper-128" else order:
                    version = server.learn(model, regime, chosen)
                    served = server.predict(model, version, windows)
                    ways = [(by_onnx, "onnx")] + ([] if args.onnx_only else [(by_torch, "safetensors")])
                    off = [np.abs(run(server.artifact(model, version, kind), windows) - served).max() / limit
                           for run, kind in ways]
                    worst = max(worst, *off)
                    said = server.call("GET", f"/v1/models/{model}/versions/{version}")
                    cells = [model, version, said["weights_sha256"][:8], made["settings"]["features"], f"{served.min():.2f} to {served.max():.2f}"]
                    cells += [f"{x:.1e}" for x in off] + ["left out"] * (2 - len(off))
                    print("|", " | ".join(map(str, cells)), "|", flush=True)
        finally:
            server.process.terminate()
            server.process.wait()
    print(f"\ngreatest difference {worst:.1e} of the limit, on {args.windows} windows of each version; allowed {BOUND:.0e}")
    sys.exit(int(worst > BOUND))


main()
