"""Uploads of the same events as Parquet, NDJSON, JSON and CSV, each to a fresh server; beside it Python into SQLite.

    python3 -m venv .venv && .venv/bin/pip install numpy pyarrow orjson
    cargo build --release
    .venv/bin/python bench/ingest.py

Makes `--events` distinct events of `--steps` steps (default 20,000 of 150: 3 million steps; numbers with all their digits,
as `json.dumps` writes them), writes them in every format to `--folder`, and uploads each file `--runs` times, each time to a
server that has just been started with a database of its own. The time is from the first byte of the request to the end of
the answer 201, which comes after the events are synced to disk. Resident memory is the server's VmHWM, the most it ever
had. Afterwards the server is killed (SIGKILL), started again and asked for the events: all of them must be there.

The other side is what one would write instead: the same file read with pyarrow (orjson for JSON), grouped into events, each
as one row with a digest and its arrays as float32, written by `executemany` in one transaction of SQLite with the same
journal and sync. It checks no physics, notes no duplicates and receives nothing over a socket.
Prints a Markdown table of medians and the conditions.
"""

import argparse
import hashlib
import http.client
import json
import os
import pathlib
import platform
import signal
import sqlite3
import statistics
import subprocess
import tempfile
import time

import numpy as np
import orjson
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

FORMATS = {
    "parquet": "application/vnd.apache.parquet",
    "ndjson": "application/x-ndjson",
    "json": "application/json",
    "csv": "text/csv",
}
ARRAYS = ("spacing_m", "follower_speed_mps", "leader_speed_mps")


def made_up(events, steps):
    """Columns of followers that lag behind a leader whose speed swings; every event is another one."""
    phase = 0.6180339887498949 * np.arange(events)[:, None]
    time_s = 0.1 * np.arange(steps)[None, :]
    leader, follower = 14 + np.sin(time_s + phase), 14 + np.sin(time_s + phase - 0.6)
    rel = leader - follower
    closing = np.cumsum(0.05 * (rel[:, 1:] + rel[:, :-1]), axis=1)
    spacing = 20 + phase % 3 + np.concatenate([np.zeros((events, 1)), closing], axis=1)
    return dict(zip(ARRAYS, (spacing, follower, leader)))


def write_files(folder, events, steps):
    """{format: path}; files that are there already are taken as they are."""
    paths = {name: folder / f"{events}x{steps}.{name}" for name in FORMATS}
    if all(path.exists() for path in paths.values()):
        return paths
    folder.mkdir(parents=True, exist_ok=True)
    arrays = made_up(events, steps)
    names, runs = [f"made-up-{k}" for k in range(events)], [f"run-{k // 50}" for k in range(events)]
    repeated = lambda values: pa.array(np.repeat(np.array(values, dtype=object), steps), pa.string())
    table = pa.table({
        "event_id": repeated(names), "source": repeated(["bench"] * events), "run": repeated(runs),
        "t": np.tile(np.round(0.1 * np.arange(steps), 3), events),
        **{name: values.reshape(-1) for name, values in arrays.items()},
    })
    pq.write_table(table, paths["parquet"])
    pyarrow.csv.write_csv(table, paths["csv"], pyarrow.csv.WriteOptions(quoting_style="none"))
    lines = []
    for k, name in enumerate(names):
        event = {"event_id": name, "source": "bench", "run": runs[k], "dt_s": 0.1}
        lines.append(json.dumps(event | {array: values[k].tolist() for array, values in arrays.items()}))
    paths["ndjson"].write_text("\n".join(lines) + "\n")
    paths["json"].write_text('{"events": [' + ", ".join(lines) + "]}")
    return paths


class Server:
    """The real binary as a child process, with the database in `folder`."""

    def __init__(self, binary, folder, settings=()):
        command = [binary, "--listen", "127.0.0.1:0", "--database", os.path.join(folder, "headway.db"),
                   "--set", "model.schedule=manual", "--set", 'log.filter="warn"',
                   *(part for setting in settings for part in ("--set", setting))]
        environment = os.environ | {"TMPDIR": str(folder)}
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
        self.address = self.process.stdout.readline().split()[-1].removeprefix("http://")

    def call(self, method, path, body=None, content_type="application/json"):
        connection = http.client.HTTPConnection(self.address, blocksize=1 << 18)
        headers = {"Content-Type": content_type}
        if hasattr(body, "name"):
            headers["Content-Length"] = str(os.path.getsize(body.name))
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        content = answer.read()
        if answer.status >= 300:
            raise SystemExit(f"{method} {path}: {answer.status} {content[:500]}")
        return json.loads(content)

    def peak_mib(self):
        status = pathlib.Path(f"/proc/{self.process.pid}/status").read_text()
        return int(next(line for line in status.splitlines() if line.startswith("VmHWM")).split()[1]) / 1024

    def stop(self, with_signal):
        self.process.send_signal(with_signal)
        self.process.wait()


def upload(args, path, media):
    """One upload to a fresh server: seconds, MiB idle, MiB after."""
    with tempfile.TemporaryDirectory(dir=args.folder) as folder:
        server = Server(args.binary, folder, args.set)
        idle = server.peak_mib()
        with path.open("rb") as body:
            began = time.perf_counter()
            receipt = server.call("POST", "/v1/models/default/batches?regime=fast", body, media)
            seconds = time.perf_counter() - began
        after = server.peak_mib()
        server.stop(signal.SIGKILL)
        if receipt["accepted"] != args.events:
            raise SystemExit(f"{path.name}: {receipt}")
        server = Server(args.binary, folder, args.set)
        kept = server.call("GET", f"/v1/models/default/batches/{receipt['batch_id']}")["events"]["pending"]
        server.stop(signal.SIGTERM)
        if kept != args.events:
            raise SystemExit(f"{path.name}: {kept} events are left after a kill")
        return seconds, idle, after


def events_of_table(table):
    """Rows of (name, run, arrays) out of a table whose rows of an event are together."""
    names, runs = table["event_id"].to_numpy(), table["run"].to_numpy()
    firsts = np.flatnonzero(np.concatenate([[True], names[1:] != names[:-1]]))
    columns = [table[name].to_numpy().astype("<f4") for name in ARRAYS]
    for first, end in zip(firsts, [*firsts[1:], len(names)]):
        yield names[first], runs[first], np.concatenate([column[first:end] for column in columns])


def events_of_json(documents):
    for event in documents:
        yield event["event_id"], event["run"], np.array([event[name] for name in ARRAYS], "<f4").reshape(-1)


def read_in_python(path):
    if path.suffix == ".parquet":
        return events_of_table(pq.read_table(path))
    if path.suffix == ".csv":
        return events_of_table(pyarrow.csv.read_csv(path))
    if path.suffix == ".json":
        return events_of_json(orjson.loads(path.read_bytes())["events"])
    with path.open("rb") as lines:
        return events_of_json([orjson.loads(line) for line in lines])


def in_python(args, path):
    """Seconds from the file to a committed transaction."""
    with tempfile.TemporaryDirectory(dir=args.folder) as folder:
        began = time.perf_counter()
        database = sqlite3.connect(os.path.join(folder, "events.db"))
        database.executescript("pragma journal_mode = wal; pragma synchronous = full;"
                               "create table event (event_id integer primary key, digest blob not null unique, name text, run text,"
                               " steps integer, arrays blob)")
        rows = ((hashlib.sha256(arrays).digest(), name, run, len(arrays) // 3, arrays.tobytes())
                for name, run, arrays in read_in_python(path))
        with database:
            database.executemany("insert into event (digest, name, run, steps, arrays) values (?, ?, ?, ?, ?)"
                                 " on conflict (digest) do nothing", rows)
        seconds = time.perf_counter() - began
        stored = database.execute("select count(*) from event").fetchone()[0]
        database.close()
        if stored != args.events:
            raise SystemExit(f"{path.name}: Python stored {stored} events")
        return seconds


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--events", type=int, default=20_000)
    cli.add_argument("--steps", type=int, default=150)
    cli.add_argument("--runs", type=int, default=3)
    cli.add_argument("--formats", default=",".join(FORMATS))
    cli.add_argument("--binary", default="target/release/headway")
    cli.add_argument("--set", action="append", default=[], metavar="SECTION.KEY=VALUE", help="a server setting")
    cli.add_argument("--no-python", action="store_true", help="Headway alone")
    cli.add_argument("--folder", type=pathlib.Path, default=pathlib.Path("ingest"), help="of the files and the databases")
    args = cli.parse_args()
    paths = write_files(args.folder, args.events, args.steps)
    million_steps = args.events * args.steps / 1e6
    print(f"{args.events} events of {args.steps} steps, medians of {args.runs} runs; {os.cpu_count()} CPUs, "
          f"{platform.machine()}, Python {platform.python_version()}, pyarrow {pa.__version__}\n")
    print("| format | MB | upload, s | million steps/s | MB/s | resident, MiB (idle) | Python, s | Python / Headway |")
    print("| --- " * 8 + "|")
    for name in args.formats.split(","):
        path = paths[name]
        megabytes = path.stat().st_size / 1e6
        runs = [upload(args, path, FORMATS[name]) for _ in range(args.runs)]
        seconds = statistics.median(run[0] for run in runs)
        idle, peak = max(run[1] for run in runs), max(run[2] for run in runs)
        python = [] if args.no_python else [in_python(args, path) for _ in range(args.runs)]
        beside = f"{statistics.median(python):.2f} | {statistics.median(python) / seconds:.1f}" if python else "– | –"
        print(f"| {name} | {megabytes:.0f} | {seconds:.2f} | {million_steps / seconds:.2f} | {megabytes / seconds:.0f} "
              f"| {peak:.0f} ({idle:.0f}) | {beside} |", flush=True)


if __name__ == "__main__":
    main()
