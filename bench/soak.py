"""Everything at once for a long time: does memory stay flat, and is nothing answered that was not asked for?

    python3 -m venv .venv && .venv/bin/pip install numpy
    cargo build --release
    .venv/bin/python bench/soak.py --minutes 60

One server, one model that learns by its schedule, promotes by its gate and keeps its newest versions and events, and clients
side by side under one seed: two that predict with the live version and older ones, simulate and read lists; one that uploads
in four encodings, sends some uploads twice and some that are wrong; one that promotes, rolls back, retracts and erases,
evaluates, and takes backups. Each answer has the status that its request asks for, or it is an error. At the end the server
is stopped, every acknowledged batch is looked for, and `headway verify` looks at the database.

Every ten seconds the process's memory is read. Prints a table over time and, from the end of the first quarter on, the line
of least squares through its private memory.
"""

import argparse
import collections
import gzip
import http.client
import json
import pathlib
import random
import subprocess
import tempfile
import threading
import time

import numpy as np

from growth import Server, json_events

MODEL = "/v1/models/soak"
WINDOW = {"follower_speed_mps": [14.0] * 10, "leader_speed_mps": [14.0] * 10, "spacing_m": [20.0] * 10}
BATCH, STEPS = 24, 60
SERVER = ("model.schedule=manual", "upkeep.spare_pages=256", "backup.keep=2")
LEARNING = {"hidden": 32, "epochs": 2, "schedule": {"min_events": 120, "max_wait_s": 20}, "retention": {"events_s": 600, "versions": 20}}


class Soak:
    """What all clients share."""

    def __init__(self, server, seed, until):
        self.server, self.seed, self.until = server, seed, until
        self.answers, self.unasked, self.acknowledged = collections.Counter(), [], []
        self.learnable = collections.deque(maxlen=40)

    def over(self):
        return time.monotonic() >= self.until


class Client(threading.Thread):
    """One of them, with a connection of its own and draws of its own."""

    def __init__(self, soak, number, turn, pause_s):
        super().__init__(daemon=True)
        self.soak, self.number, self.turn, self.pause_s = soak, number, turn, pause_s
        self.random = random.Random(f"{soak.seed} {number}")
        self.connection = http.client.HTTPConnection(soak.server.address, timeout=120)
        self.turns = 0

    def run(self):
        while not self.soak.over():
            try:
                self.turn(self)
            except Exception as error:  # noqa: BLE001: whatever it is, it was not asked for
                self.soak.unasked.append(f"client {self.number}: {error!r}")
                self.connection.close()
            self.turns += 1
            time.sleep(self.pause_s)

    def ask(self, method, path, body=None, expect=(200,), **headers):
        """Status and content; anything but what is expected is an error."""
        if body is not None and not isinstance(body, bytes):
            body = json.dumps(body).encode()
        headers = {"Content-Type": "application/json"} | {name.replace("_", "-"): value for name, value in headers.items()}
        self.connection.request(method, path, body, headers)
        answer = self.connection.getresponse()
        content = answer.read()
        self.soak.answers[f"{method} {path.split('?')[0].split('/')[-1] if '/batches/' not in path else 'batch'} {answer.status}"] += 1
        if answer.status not in expect:
            self.soak.unasked.append(f"{method} {path}: {answer.status} {content[:300]!r}")
        return answer.status, json.loads(content) if content[:1] == b"{" else content


def predicts(client):
    """One of the requests of somebody who drives."""
    draw = client.random.random()
    if draw < 0.9:
        client.ask("POST", f"{MODEL}/predict", {"windows": [WINDOW] * client.random.randint(1, 4)})
    elif draw < 0.95:
        _, model = client.ask("GET", MODEL)
        version = max(1, model["head"] - client.random.randint(0, 3))
        # One that a replay skipped or retention emptied may be named: it says so.
        client.ask("POST", f"{MODEL}/predict", {"windows": [WINDOW], "version": version}, expect=(200, 404, 410))
    elif draw < 0.97:
        client.ask("POST", f"{MODEL}/simulate", {"initial": WINDOW, "leader_speed_mps": [14.0] * 200})
    elif draw < 0.99:
        client.ask("POST", f"{MODEL}/predict", {"windows": [WINDOW] * 500})
    else:
        for path in (f"{MODEL}/versions?page_size=100", f"{MODEL}/tasks?page_size=100", f"{MODEL}/batches?page_size=100", f"{MODEL}/history", "/metrics"):
            client.ask("GET", path)


def encoded(events, draw):
    """A body and its headers."""
    if draw == 0:
        return json.dumps({"events": events}).encode(), {}
    lines = "\n".join(json.dumps(event) for event in events).encode()
    if draw == 1:
        return lines, {"Content_Type": "application/x-ndjson"}
    if draw == 2:
        return gzip.compress(lines, 1), {"Content_Type": "application/x-ndjson", "Content_Encoding": "gzip"}
    rows = ["event_id,t,spacing_m,follower_speed_mps,leader_speed_mps"]
    for event in events:
        arrays = zip(event["spacing_m"], event["follower_speed_mps"], event["leader_speed_mps"])
        rows += [f"{event['event_id']},{k / 10},{s},{f},{l}" for k, (s, f, l) in enumerate(arrays)]
    return "\n".join(rows).encode(), {"Content_Type": "text/csv"}


def uploads(client):
    """Events that were never seen, now and then twice, now and then wrong."""
    regime = ("slow", "fast")[client.turns // 50 % 2]
    events = json_events(1_000 + client.turns * BATCH, BATCH, STEPS)
    body, headers = encoded(events, client.random.randrange(4))
    path = f"{MODEL}/batches?regime={regime}&dt_s=0.1"
    if client.turns % 20 == 7:
        client.ask("POST", path, body[: len(body) // 2], expect=(400, 422, 201), **headers)
    key = f"soak-{client.turns}"
    _, receipt = client.ask("POST", path, body, expect=(201,), Idempotency_Key=key, **headers)
    client.soak.acknowledged.append(receipt["batch_id"])
    client.soak.learnable.append(receipt["batch_id"])
    if client.turns % 10 == 3:
        _, again = client.ask("POST", path, body, expect=(201,), Idempotency_Key=key, **headers)
        if again != receipt:
            client.soak.unasked.append(f"{key} was answered otherwise the second time")


def operates(client):
    """What people do to a model. Its pause is ten seconds."""
    _, model = client.ask("GET", MODEL)
    live, head = model["live"], model["head"]
    reason = f"soak {client.turns}"
    version = max(1, head - client.random.randint(0, 4))
    # Another's retraction may have tainted it, retention may have emptied it.
    client.ask("POST", f"{MODEL}/promote", {"version": version, "reason": reason, "force": True}, expect=(200, 404, 409, 410))
    if client.turns % 6 == 5 and live > 3:
        client.ask("POST", f"{MODEL}/rollback", {"version": max(1, head - 1), "reason": reason, "force": True}, expect=(200, 404, 409, 410))
    if client.turns % 12 == 8 and len(client.soak.learnable) > 20:
        batch = client.soak.learnable.popleft() if client.turns % 24 == 8 else client.soak.learnable[-8]
        erase = "?erase=true" if client.turns % 24 == 8 else ""
        # Refused when events are gone that a replay would need.
        client.ask("DELETE", f"{MODEL}/batches/{batch}{erase}", expect=(200, 202, 409))
    if client.turns % 3 == 1:
        events = {"events": json_events(500, 8, STEPS)}
        client.ask("POST", f"{MODEL}/evaluate?references=constant", events)
    if client.turns % 30 == 29:
        client.ask("POST", "/v1/backup", expect=(201,))


def memory(process):
    """MiB resident, MiB of them private, threads, open files."""
    status = pathlib.Path(f"/proc/{process}/status").read_text().splitlines()
    fields = dict(line.split(":", 1) for line in status)
    kib = [int(fields[name].split()[0]) / 1024 for name in ("VmRSS", "RssAnon")]
    return *kib, int(fields["Threads"]), len(list(pathlib.Path(f"/proc/{process}/fd").iterdir()))


def watched(server, soak, database, minutes):
    """A row each ten seconds: minutes, memory, sizes of files (MiB), and answers so far."""
    rows, began = [], time.monotonic()
    while not soak.over():
        time.sleep(10)
        sizes = [path.stat().st_size / 2**20 for path in (database, database.with_name(database.name + "-wal"))]
        rows.append(((time.monotonic() - began) / 60, *memory(server.process.pid), *sizes, sum(soak.answers.values()), len(soak.unasked)))
        if len(rows) % 30 == 0:
            print("| " + " | ".join(f"{value:.1f}" if isinstance(value, float) else str(value) for value in rows[-1]) + " |", flush=True)
    return np.array(rows)


def listed(server, what, name):
    """The names of all entries of one of the model's lists."""
    token = ""
    while True:
        page = server.call("GET", f"{MODEL}/{what}?page_size=1000{token}")
        yield from (entry[name] for entry in page[what])
        if not page["next_page_token"]:
            return
        token = f"&page_token={page['next_page_token']}"


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--minutes", type=float, default=60)
    cli.add_argument("--seed", type=int, default=1)
    cli.add_argument("--binary", default="target/release/headway")
    args = cli.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        database = pathlib.Path(folder, "headway.db")
        server = Server(args.binary, database, [*SERVER, f'backup.folder="{folder}/backups"'])
        server.call("POST", "/v1/models", {"model": "soak", "method": "ewc", "settings": LEARNING})
        server.learn("soak", "fast", json_events(0, 60, STEPS))
        soak = Soak(server, args.seed, time.monotonic() + 60 * args.minutes)
        clients = [Client(soak, number, turn, pause) for number, (turn, pause) in
                   enumerate([(predicts, 0.004), (predicts, 0.02), (uploads, 1.5), (operates, 10.0)])]
        print("| minutes | resident, MiB | private, MiB | threads | files | database, MiB | log, MiB | answers | errors |\n"
              "| --- | --- | --- | --- | --- | --- | --- | --- | --- |", flush=True)
        for client in clients:
            client.start()
        rows = watched(server, soak, database, args.minutes)
        for client in clients:
            client.join(timeout=180)
        # The server has hung up by now: nothing was asked on this connection all the time.
        server.connection.close()
        model = server.call("GET", MODEL)
        kept = set(listed(server, "batches", "batch_id"))
        server.stop()
        lost = set(soak.acknowledged) - kept
        verified = subprocess.run([args.binary, "verify", "--database", database], capture_output=True, text=True)
    later = rows[rows[:, 0] > rows[-1, 0] / 4]
    slope, _ = np.polyfit(later[:, 0] / 60, later[:, 2], 1)
    halves = [np.median(half[:, 2]) for half in np.array_split(later, 2)]
    print(f"\nprivate memory after the first quarter: {slope:+.1f} MiB an hour, medians of its halves {halves[0]:.1f} and {halves[1]:.1f} MiB, "
          f"most {later[:, 2].max():.1f} MiB")
    print(f"head {model['head']}, live {model['live']}, {len(soak.acknowledged)} batches acknowledged, {len(lost)} lost; "
          f"exit code {server.process.returncode}; verify: {verified.stdout.splitlines()[-1] if verified.stdout else verified.stderr}")
    print("\n".join(f"{count:8} {what}" for what, count in sorted(soak.answers.items())))
    print(f"{len(soak.unasked)} errors")
    print("\n".join(soak.unasked[:20]))
    if soak.unasked or lost or verified.returncode or server.process.returncode:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
