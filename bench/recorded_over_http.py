"""The paper's protocol on recorded events, through a running server over HTTP.

    python3 -m venv .venv && .venv/bin/pip install pyarrow pandas
    cargo build --release
    .venv/bin/python bench/recorded_over_http.py --splits protocol_random.csv --events waymo.parquet ngsim_i80.parquet ...

Starts `target/release/headway` on a free port with a database of its own.
For every seed and method it creates a model, uploads the tasks' events in turn (cut to their first `--steps` steps, the
split said by the upload), lets each be learned before the next is sent, and reads every figure from the evaluation of the
versions. Settings are the server's defaults unless `--set NAME=VALUE` says otherwise.
Prints one row per seed and method, the table of means as Markdown, and writes everything to `--out` as JSON.
"""

import argparse
import hashlib
import io
import json
import os
import pathlib
import subprocess
import tempfile
import urllib.error
import urllib.request

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

REGIMES = ("fast", "middle", "slow")
COLUMNS = ["event_id", "source", "run", "t", "spacing", "sv_speed", "lv_speed", "rel_speed"]


def read_tasks(paths, splits, steps):
    """One table per task, in the order of the file's task numbers: the cut events with their split."""
    events = pd.concat([pq.read_table(path, columns=COLUMNS).to_pandas() for path in paths])
    events = events[events.groupby("event_id").cumcount() < steps]
    rows = pd.read_csv(splits)
    absent = set(rows.event_id) - set(events.event_id)
    if absent:
        raise SystemExit(f"{len(absent)} events of {splits} are in none of the --events files, e.g. {min(absent)}")
    events = events.merge(rows, on="event_id")
    return [group.drop(columns="task") for _, group in events.groupby("task", sort=True)]


def parquet(table):
    body = io.BytesIO()
    pq.write_table(pa.Table.from_pandas(table, preserve_index=False), body)
    return body.getvalue()


class Server:
    """The real binary as a child process."""

    def __init__(self, binary, folder, threads):
        command = [binary, "--listen", "127.0.0.1:0", "--database", os.path.join(folder, "headway.db"),
                   "--set", f"training.training_threads={threads}", "--set", 'log.filter="warn"']
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.url = self.process.stdout.readline().split()[-1]

    def call(self, method, path, body=None, content_type="application/json"):
        if body is not None and not isinstance(body, bytes):
            body = json.dumps(body).encode()
        request = urllib.request.Request(self.url + path, body, {"Content-Type": content_type}, method=method)
        try:
            with urllib.request.urlopen(request) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as error:
            raise SystemExit(f"{method} {path}: {error.code} {error.read().decode()}") from None

    def learn(self, model, regime, body):
        """Uploads one task's events and learns them; the task at its end."""
        path = f"/v1/models/{model}"
        receipt = self.call("POST", f"{path}/batches?preset=follownet&regime={regime}", body,
                            "application/vnd.apache.parquet")
        if receipt["rejected_count"]:
            raise SystemExit(f"{receipt['rejected_count']} events were rejected: {receipt['rejected'][:3]}")
        task = self.call("POST", f"{path}/tasks", {"batches": [receipt["batch_id"]], "regime": regime})
        while task["state"] in ("queued", "running"):
            task = self.call("GET", f"{path}/tasks/{task['task_id']}?wait_s=60")
        if task["state"] != "succeeded":
            raise SystemExit(f"{model}, {regime}: {task}")
        return task


def setting(text):
    """NAME=VALUE, the value in JSON, or a word as it is."""
    name, value = text.split("=", 1)
    try:
        return name, json.loads(value)
    except ValueError:
        return name, value


def run(server, variant, seed, settings, bodies):
    """Learns the tasks in turn; the evaluation of each stage and the strength and lambda used."""
    method, *own = variant.split("+")
    model = f"{method}-{seed}-{hashlib.sha256(variant.encode()).hexdigest()[:8]}"
    settings = {"seed": seed, "schedule": "manual", "promotion": "auto", **settings, **dict(map(setting, own))}
    server.call("POST", "/v1/models", {"model": model, "method": method, "settings": settings})
    stages = []
    for regime, body in zip(REGIMES, bodies):
        version = server.learn(model, regime, body)["version"]
        path = f"/v1/models/{model}/versions/{version}"
        kept, evaluation = server.call("GET", path), server.call("GET", f"{path}/evaluation")
        tasks = {task["regime"]: task for task in evaluation["tasks"]}
        stages.append({"lambda": kept["lambda"], "strength": kept["strength"], "tasks": tasks})
    return {"method": variant, "seed": seed, "stages": stages}


def error(result, stage, task, measure="spacing_mse"):
    """R[stage, task], from 1."""
    return result["stages"][stage - 1]["tasks"][REGIMES[task - 1]][measure]


def row(result, naive, joint):
    """The figures of the issue for one run."""
    collisions = [max(error(result, i, j, "collision_rate_percent") for j in range(1, i + 1)) for i in (1, 2, 3)]
    mean = sum(error(result, 3, j) for j in (1, 2, 3)) / 3
    return {
        **{f"R[3,{j}]": error(result, 3, j) for j in (1, 2, 3)},
        "mean": mean,
        "mean / joint": mean / (sum(error(joint, 3, j) for j in (1, 2, 3)) / 3) if joint else float("nan"),
        "R[3,1]/R[1,1]": error(result, 3, 1) / error(result, 1, 1),
        "R[3,2]/R[2,2]": error(result, 3, 2) / error(result, 2, 2),
        "R[2,2]/naive": error(result, 2, 2) / error(naive, 2, 2) if naive else float("nan"),
        "R[3,3]/naive": error(result, 3, 3) / error(naive, 3, 3) if naive else float("nan"),
        "worst collisions %": max(collisions),
    }


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--events", nargs="+", required=True)
    cli.add_argument("--splits", required=True, help="CSV with columns event_id, task, split")
    cli.add_argument("--methods", default="naive,joint,ewc,mas",
                     help="naive and joint first: the others are compared with them; METHOD+NAME=VALUE+… is the method with "
                          "settings of its own, e.g. ewc+estimator=sampled+output=closed_loop")
    cli.add_argument("--seeds", default="42,43,44")
    cli.add_argument("--steps", type=int, default=150)
    cli.add_argument("--threads", type=int, default=os.cpu_count())
    cli.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a model setting")
    cli.add_argument("--binary", default="target/release/headway")
    cli.add_argument("--out", type=pathlib.Path)
    args = cli.parse_args()
    settings = dict(map(setting, args.set))
    bodies = [parquet(table) for table in read_tasks(args.events, args.splits, args.steps)]
    results, rows = {}, {}
    with tempfile.TemporaryDirectory() as folder:
        server = Server(args.binary, folder, args.threads)
        try:
            for seed in args.seeds.split(","):
                for method in args.methods.split(","):
                    result = results[method, seed] = run(server, method, int(seed), settings, bodies)
                    figures = row(result, results.get(("naive", seed)), results.get(("joint", seed)))
                    rows[method, seed] = figures
                    print(method, seed, {name: round(value, 3) for name, value in figures.items()},
                          "lambda", [stage["lambda"] for stage in result["stages"]], flush=True)
        finally:
            server.process.terminate()
            server.process.wait()
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis(["method", "seed"])
    means = table.groupby("method", sort=False).mean()
    print("\n| method | " + " | ".join(means.columns) + " |\n| --- |" + " --- |" * len(means.columns))
    for method, figures in means.iterrows():
        print(f"| {method} | " + " | ".join(f"{value:.2f}" for value in figures) + " |")
    print(f"\nworst collision rate of any seed: {table['worst collisions %'].groupby('method').max().to_dict()}")
    if args.out:
        args.out.write_text(json.dumps({"args": vars(args) | {"out": str(args.out)}, "runs": list(results.values())}, indent=1))


if __name__ == "__main__":
    main()
