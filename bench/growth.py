"""Start-up and answers of a server whose history has grown, beside one with 10 x fewer events and 100 x fewer versions.

    python3 -m venv .venv && .venv/bin/pip install numpy
    cargo build --release
    .venv/bin/python bench/growth.py

Lets a server with the default network learn one small task, and fills two copies of its database with SQL: by default
100,000 events and 10 versions, and 1,000,000 events and 1,000 versions. Events are short (`--steps`, 20) and all different;
they came in batches of 20,000, the last of which waits to be learned; every version has weights of its own (those learned,
a little changed), a task with a ledger of 900 events, an evaluation and an entry in the history.
Times the start, from exec to the line `listening on` and to the first 200 of `/readyz`, with the file in the page cache; once
more after a kill; then medians of requests over one kept connection, lists at their last page. At last `pending` is asked for,
which claims the 20,000 events that wait, 2,000 events are uploaded, and tasks of 1,000 and of 10,000 events are learned
with a small network.
Prints a Markdown table.
"""

import argparse
import datetime
import hashlib
import http.client
import json
import os
import pathlib
import shutil
import signal
import sqlite3
import statistics
import subprocess
import tempfile
import time

import numpy as np

PER_BATCH, PER_TASK, PENDING = 20_000, 900, "waiting"


class Server:
    """The real binary as a child process."""

    def __init__(self, binary, database, settings=("model.schedule=manual",)):
        environment = os.environ | {"TMPDIR": str(database.parent)}
        began = time.perf_counter()
        self.process = subprocess.Popen([binary, "--listen", "127.0.0.1:0", "--database", str(database),
                                         "--set", 'log.filter="error"', *(f"--set={setting}" for setting in settings)],
                                        stdout=subprocess.PIPE, text=True, env=environment)
        self.address = self.process.stdout.readline().split()[-1].removeprefix("http://")
        self.listening_s = time.perf_counter() - began
        self.connection = http.client.HTTPConnection(self.address)
        self.call("GET", "/readyz")
        self.ready_s = time.perf_counter() - began

    def call(self, method, path, body=None):
        self.connection.request(method, path, json.dumps(body) if body is not None else None, {"Content-Type": "application/json"})
        answer = self.connection.getresponse()
        content = answer.read()
        if answer.status >= 300:
            raise SystemExit(f"{method} {path}: {answer.status} {content[:500]}")
        return json.loads(content) if content[:1] == b"{" else content

    def learn(self, model, regime, events):
        """Uploads and learns; the task at its end."""
        batch = self.call("POST", f"/v1/models/{model}/batches?regime={regime}", {"events": events})["batch_id"]
        task = self.call("POST", f"/v1/models/{model}/tasks", {"batches": [batch]})
        while task["state"] in ("queued", "running"):
            task = self.call("GET", f"/v1/models/{model}/tasks/{task['task_id']}?wait_s=60")
        if task["state"] != "succeeded":
            raise SystemExit(task)
        return task

    def stop(self, with_signal=signal.SIGTERM):
        self.process.send_signal(with_signal)
        self.process.wait()


def made_up(first, count, steps):
    """Arrays of `count` followers behind a leader; every number gives another event."""
    phase = 0.6180339887498949 * np.arange(first, first + count)[:, None]
    time_s = 0.1 * np.arange(steps)[None, :]
    leader, follower = 14 + np.sin(time_s + phase), 14 + np.sin(time_s + phase - 0.6)
    rel = leader - follower
    spacing = 20 + phase % 3 + np.concatenate(
        [np.zeros((count, 1)), np.cumsum(0.05 * (rel[:, 1:] + rel[:, :-1]), axis=1)], axis=1)
    return spacing, follower, leader


def json_events(first, count, steps, **more):
    names = ("spacing_m", "follower_speed_mps", "leader_speed_mps")
    rows = zip(*(array.tolist() for array in made_up(first, count, steps)))
    return [{"event_id": f"e{first + k}", "dt_s": 0.1, **more, **dict(zip(names, row))} for k, row in enumerate(rows)]


def rows_of(db, table):
    cursor = db.execute(f"select * from {table} limit 1")
    return dict(zip([column[0] for column in cursor.description], cursor.fetchone()))


def insert(db, table, rows):
    rows = list(rows)
    names = ", ".join(rows[0])
    db.executemany(f"insert into {table} ({names}) values ({', '.join('?' * len(rows[0]))})", [tuple(row.values()) for row in rows])


def fill(path, events, versions, steps):
    """Adds events and versions to the database of a server that has learned one task."""
    db = sqlite3.connect(path)
    db.executescript("pragma journal_mode = off; pragma synchronous = off; pragma cache_size = -1000000; pragma foreign_keys = off")
    batch, event, task, version = (rows_of(db, table) for table in ("batch", "event", "task", "version"))
    regime, history = rows_of(db, "version_regime"), rows_of(db, "history")
    learned = np.frombuffer(db.execute("select weights from weights").fetchone()[0], "<f4")
    first_event = db.execute("select max(event_id) from event").fetchone()[0] + 1
    for batch_id in range(2, 2 + events // PER_BATCH):
        first = first_event + (batch_id - 2) * PER_BATCH
        last = batch_id == 1 + events // PER_BATCH
        insert(db, "batch", [batch | {"batch_id": batch_id, "accepted": PER_BATCH}])
        arrays = np.stack(made_up(first, PER_BATCH, steps), axis=1).astype("<f4").reshape(PER_BATCH, -1)
        blobs = [values.tobytes() for values in arrays]
        dt = np.array([0.1], "<f8").tobytes()
        state, name = ("pending", PENDING) if last else ("learned", "fast")
        insert(db, "event", ({**event, "event_id": first + k, "batch_id": batch_id, "name": f"e{first + k}", "state": state, "regime": name,
                              "content_sha256": hashlib.sha256(dt + blob).digest(), "steps": steps, "arrays": blob,
                              "mean_speed_mps": 14.0, "split": ("train", "train", "test")[k % 3]} for k, blob in enumerate(blobs)))
        insert(db, "batch_event", ({"batch_id": batch_id, "ordinal": k, "event_id": first + k, "duplicate": 0} for k in range(PER_BATCH)))
    draw = np.random.default_rng(7)
    for number in range(2, versions + 1):
        weights = (learned * (1 + 1e-3 * draw.standard_normal(len(learned)))).astype("<f4").tobytes()
        insert(db, "task", [task | {"task_id": number, "version": number, "parent_version": number - 1, "stage": number}])
        first = first_event + (number - 2) * PER_TASK
        insert(db, "task_batch", [{"task_id": number, "batch_id": 2 + (number - 2) * PER_TASK // PER_BATCH}])
        insert(db, "task_event", ({"task_id": number, "event_id": first + k} for k in range(PER_TASK)))
        insert(db, "version", [version | {"version": number, "task_id": number, "parent": number - 1, "stage": number,
                                          "weights_sha256": hashlib.sha256(weights).digest()}])
        insert(db, "weights", [{"model_id": 1, "version": number, "weights": weights}])
        insert(db, "version_regime", [regime | {"version": number, "learned_stage": number, "learned_version": number}])
        insert(db, "history", [history | {"history_id": number, "from_live": number - 1, "live": number}])
    db.execute("update model set live_version = ?1, head_version = ?1 where model_id = 1", (versions,))
    db.commit()
    db.close()


def last_page(server, path):
    """The path of a list's last page."""
    token, page = None, f"{path}?page_size=10"
    while True:
        token = server.call("GET", page)["next_page_token"]
        if not token:
            return page
        page = f"{path}?page_size=10&page_token={token}"


def median_ms(server, method, path, body=None, times=200):
    taken = []
    for _ in range(times):
        began = time.perf_counter()
        server.call(method, path, body)
        taken.append(1e3 * (time.perf_counter() - began))
    return statistics.median(taken)


def seconds(task):
    """From a task's start to its end."""
    started, ended = (datetime.datetime.fromisoformat(task[name]) for name in ("started_at", "ended_at"))
    return (ended - started).total_seconds()


def measured(args, database):
    """{figure: value}"""
    starts = []
    for _ in range(args.runs):
        server = Server(args.binary, database)
        starts.append((server.listening_s, server.ready_s))
        server.stop()
    figures = {"MB on disk": database.stat().st_size / 1e6,
               "exec to `listening`, ms": 1e3 * statistics.median(start[0] for start in starts),
               "exec to ready, ms": 1e3 * statistics.median(start[1] for start in starts)}
    server = Server(args.binary, database)
    model, last_batch = "/v1/models/default", last_page(server, "/v1/models/default/batches")
    batches = server.call("GET", last_batch)["batches"]
    window = {"follower_speed_mps": [14.0] * 10, "leader_speed_mps": [14.0] * 10, "spacing_m": [20.0] * 10}
    for name, path in (("models", "/v1/models"), ("batches", last_batch), ("tasks", last_page(server, f"{model}/tasks")),
                       ("versions", last_page(server, f"{model}/versions")), ("history", last_page(server, f"{model}/history"))):
        figures[f"GET {name}, last page, ms"] = median_ms(server, "GET", path)
    figures["GET a batch of 20,000 events, counted by state, ms"] = median_ms(server, "GET", f"{model}/batches/{batches[-1]['batch_id']}", times=20)
    figures["GET /metrics, ms"] = median_ms(server, "GET", "/metrics")
    figures["predict, one window, ms"] = median_ms(server, "POST", f"{model}/predict", {"windows": [window]})
    server.stop(signal.SIGKILL)
    server = Server(args.binary, database)
    figures["exec to ready after SIGKILL, ms"] = 1e3 * server.ready_s
    server.call("POST", f"{model}/pause", {})
    began = time.perf_counter()
    server.call("POST", f"{model}/tasks", {"batches": "pending"})
    figures["POST tasks that claims 20,000 events, ms"] = 1e3 * (time.perf_counter() - began)
    server.call("POST", "/v1/models", {"model": "small", "method": "naive", "settings": {"hidden": 16, "epochs": 1, "schedule": "manual"}})
    events = {"events": json_events(10**8, 2000, args.steps)}
    began = time.perf_counter()
    server.call("POST", "/v1/models/small/batches?regime=fast", events)
    figures["upload of 2,000 events, ms"] = 1e3 * (time.perf_counter() - began)
    for count in (1000, 10_000):
        events = json_events(2 * 10**8 + 10**6 * count, count, 60, split="train")
        figures[f"task of {count:,} events of 60 steps, ms"] = 1e3 * seconds(server.learn("small", f"of-{count}", events))
    server.stop()
    return figures


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--events", type=int, default=1_000_000)
    cli.add_argument("--versions", type=int, default=1000)
    cli.add_argument("--steps", type=int, default=20)
    cli.add_argument("--runs", type=int, default=5, help="starts")
    cli.add_argument("--binary", default="target/release/headway")
    cli.add_argument("--folder", type=pathlib.Path, default=pathlib.Path("growth"),
                     help="of the filled databases, which are kept and taken as they are")
    args = cli.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    sizes = [(args.events // 10, max(args.versions // 100, 2)), (args.events, args.versions)]
    filled = [args.folder / f"{events}x{args.steps}-{versions}.db" for events, versions in sizes]
    tables = []
    with tempfile.TemporaryDirectory(dir=args.folder) as folder:
        seed = pathlib.Path(folder, "seed.db")
        for path, (events, versions) in zip(filled, sizes):
            if not path.exists():
                if not seed.exists():
                    server = Server(args.binary, seed)
                    server.learn("default", "fast", json_events(0, 60, 40))
                    server.stop()
                beside = path.with_suffix(".new")
                shutil.copy(seed, beside)
                fill(beside, events, versions, args.steps)
                beside.replace(path)
        for path in filled:
            copy = pathlib.Path(folder, "headway.db")
            shutil.copy(path, copy)
            tables.append(measured(args, copy))
    names = [f"{events:,} events, {versions:,} versions" for events, versions in sizes]
    print(f"| figure | {names[0]} | {names[1]} | ratio |\n| --- | --- | --- | --- |")
    for name, small in tables[0].items():
        print(f"| {name} | {small:.2f} | {tables[1][name]:.2f} | {tables[1][name] / small:.2f} |")


if __name__ == "__main__":
    main()
