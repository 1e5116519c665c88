"""How long a fork, an archive and taking it in last, and how long another change waits meanwhile.

    python bench/copies.py [--headway target/release/headway] [--events 100000] [--steps 150]

One model learns a batch of that many events, nearly all of them for tests, so that learning is short and copying is not.
"""

import argparse
import json
import random
import re
import subprocess
import tempfile
import threading
import time
import urllib.request


def call(url, method, path, body=None, kind="application/json"):
    request = urllib.request.Request(url + path, method=method, data=body, headers={"Content-Type": kind})
    with urllib.request.urlopen(request) as answer:
        return answer.read()


def event(name, steps, split, draw):
    spacing, speed = 15 + 10 * draw.random(), 8 + 4 * draw.random()
    return json.dumps({"event_id": name, "split": split, "dt_s": 0.1, "spacing_m": [round(spacing, 3)] * steps,
                       "follower_speed_mps": [round(speed, 3)] * steps, "leader_speed_mps": [round(speed, 3)] * steps})


def waits(url, until):
    """The longest that a small change takes until then, s."""
    longest = 0.0
    while not until.is_set():
        begun = time.perf_counter()
        call(url, "PATCH", "/v1/models/big/versions/1", json.dumps({"note": str(begun)}).encode())
        longest = max(longest, time.perf_counter() - begun)
    return longest


def timed(url, what, work):
    done, kept = threading.Event(), []
    beside = threading.Thread(target=lambda: kept.append(waits(url, done)))
    beside.start()
    begun = time.perf_counter()
    result = work()
    took = time.perf_counter() - begun
    done.set()
    beside.join()
    print(f"{what}: {took:.2f} s, another change waited at most {kept[0]:.2f} s", flush=True)
    return result


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--headway", default="target/release/headway")
    parser.add_argument("--events", type=int, default=100_000)
    parser.add_argument("--steps", type=int, default=150)
    given = parser.parse_args()
    draw = random.Random(42)
    with tempfile.TemporaryDirectory() as folder:
        command = [given.headway, "--listen", "127.0.0.1:0", "--database", f"{folder}/headway.db", "--set", "log.filter=error"]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            url = re.search(r"http://\S+", server.stdout.readline())[0]
            settings = {"hidden": 4, "horizon": 5, "epochs": 1, "schedule": "manual", "promotion": "auto"}
            call(url, "POST", "/v1/models", json.dumps({"model": "big", "method": "naive", "settings": settings}).encode())
            train = [event(f"train-{i}", given.steps, "train", draw) for i in range(100)]
            tests = [event(f"test-{i}", given.steps, "test", draw) for i in range(given.events - 100)]
            call(url, "POST", "/v1/models/big/batches", "\n".join(train + tests).encode(), "application/x-ndjson")
            task = json.loads(call(url, "POST", "/v1/models/big/tasks", b'{"batches": "pending"}'))["task_id"]
            while json.loads(call(url, "GET", f"/v1/models/big/tasks/{task}?wait_s=60"))["state"] != "succeeded":
                pass
            wish = {"model": "fork", "method": "naive", "from": {"model": "big", "version": 1}}
            timed(url, "fork", lambda: call(url, "POST", "/v1/models", json.dumps(wish).encode()))
            archive = timed(url, "archive", lambda: call(url, "GET", "/v1/models/big/archive"))
            print(f"{len(archive) / 1e6:.0f} MB")
            kind = "application/vnd.sqlite3"
            timed(url, "take in", lambda: call(url, "POST", "/v1/models/moved/archive", archive, kind))
        finally:
            server.terminate()
            server.wait()


if __name__ == "__main__":
    main()
