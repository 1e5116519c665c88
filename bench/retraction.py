"""How long a retraction of many events holds the one connection that writes.

    python3 -m venv .venv && .venv/bin/pip install numpy
    cargo build --release
    .venv/bin/python bench/retraction.py

Lets a server learn one small batch, and fills that batch and its task's ledger up to `--events` of `--steps` with SQL, as waiting
events (`--state pending`) or as learned ones. Then the batch is retracted, and training is paused right after that was asked:
what the pause waits is how long the retraction holds everybody up. Beside the time the process's own is told, which does not
depend on who else uses the machine.
"""

import argparse
import hashlib
import http.client
import os
import pathlib
import sqlite3
import tempfile
import threading
import time

from growth import Server, insert, json_events, made_up, rows_of

MODEL = "/v1/models/default"


def fill(path, events, steps, state):
    """More events in batch 1, all different; learned ones in the ledger of task 1 as well."""
    db = sqlite3.connect(path)
    db.execute("pragma foreign_keys = off")
    event = rows_of(db, "event")
    first = db.execute("select max(event_id) from event").fetchone()[0] + 1
    names = range(first, 1 + events)
    for start in range(names.start, names.stop, 10_000):
        part = range(start, min(start + 10_000, names.stop))
        blobs = [values.tobytes() for values in made_up(part[0], len(part), steps)[0].astype("<f4").repeat(3, axis=1)]
        insert(db, "event", ({**event, "event_id": k, "batch_id": 1, "name": f"e{k}", "state": state, "steps": steps, "arrays": blob,
                              "content_sha256": hashlib.sha256(blob).digest(), "split": ("train", "train", "test")[k % 3]}
                             for k, blob in zip(part, blobs)))
        insert(db, "batch_event", ({"batch_id": 1, "ordinal": k, "event_id": k, "duplicate": 0} for k in part))
        if state == "learned":
            insert(db, "task_event", ({"task_id": 1, "event_id": k} for k in part))
    db.commit()
    db.close()


def own_time_s(server):
    """Of all threads, in user and kernel mode."""
    fields = pathlib.Path(f"/proc/{server.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def pause(address):
    """Another change, and how long it waits."""
    connection = http.client.HTTPConnection(address)
    began = time.perf_counter()
    connection.request("POST", f"{MODEL}/pause", "{}", {"Content-Type": "application/json"})
    status = connection.getresponse().status
    print(f"a change that came meanwhile: {status} after {time.perf_counter() - began:.2f} s")


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--events", type=int, default=100_000)
    cli.add_argument("--steps", type=int, default=150)
    cli.add_argument("--state", choices=("pending", "learned"), default="learned")
    cli.add_argument("--binary", default="target/release/headway")
    args = cli.parse_args()
    with tempfile.TemporaryDirectory(dir=".") as folder:
        database = pathlib.Path(folder) / "headway.db"
        server = Server(args.binary, database)
        if args.state == "learned":
            server.learn("default", "fast", json_events(0, 30, args.steps))
        else:
            server.call("POST", f"{MODEL}/batches?regime=fast", {"events": json_events(0, 30, args.steps)})
        server.stop()
        fill(database, args.events, args.steps, args.state)
        server = Server(args.binary, database)
        try:
            other = threading.Timer(0.05, pause, [server.address])
            began, own = time.perf_counter(), own_time_s(server)
            other.start()
            server.call("DELETE", f"{MODEL}/batches/b1")
            elapsed, own = time.perf_counter() - began, own_time_s(server) - own
            other.join()
        finally:
            server.stop()
        print(f"{args.events} {args.state} events of {args.steps} steps: {elapsed:.2f} s, {own:.2f} s of processor time")


if __name__ == "__main__":
    main()
