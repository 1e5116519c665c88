"""Predictions from Python: arrays as binary tensors, as the client sends them, beside JSON, in turn.

    cargo build --release
    pip install ./python
    HEADWAY_BINARY=target/release/headway python python/bench/windows.py

Starts the server with the paper's network (128 hidden units), lets it learn something, and prints a Markdown table of
medians of `--rounds` rounds of 50 calls, each way on a connection of its own.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import httpx
import numpy as np

from headway import Client

NAMES = ["follower_speed_mps", "leader_speed_mps", "spacing_m"]


def milliseconds(ask: Callable[[], object]) -> float:
    """Of one call, the mean of fifty."""
    began = time.perf_counter()
    for _ in range(50):
        ask()
    return 1000 * (time.perf_counter() - began) / 50


def compare(url: str, count: int, rounds: int) -> tuple[float, float]:
    """Medians of JSON and of binary tensors, ms, of so many windows a call."""
    client, plain = Client(url).model(), httpx.Client()
    windows = np.random.default_rng(7).uniform(8, 12, (count, 10, 4)).astype(np.float32)

    def as_json() -> object:
        parts = windows[:, :, [0, 1, 3]].transpose(0, 2, 1).tolist()
        body = {"windows": [dict(zip(NAMES, window, strict=True)) for window in parts]}
        said = plain.post(f"{url}/v1/models/default/predict", json=body).json()
        return np.array([each["accel_mps2"] for each in said["predictions"]])

    asked: list[Callable[[], object]] = [as_json, lambda: client.predict(windows)]
    times = [[milliseconds(ask) for ask in asked] for _ in range(rounds)]
    return statistics.median(time[0] for time in times), statistics.median(time[1] for time in times)


def main() -> None:
    """Runs the comparison."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=9)
    rounds = parser.parse_args().rounds
    binary = Path(os.environ.get("HEADWAY_BINARY", "target/release/headway"))
    with tempfile.TemporaryDirectory() as folder:
        settings = ["hidden=128", "horizon=10", "features=raw", "memory=window", "epochs=1", "schedule=manual"]
        named = [part for setting in settings for part in ("--set", f"model.{setting}")]
        command = [str(binary), "--listen", "127.0.0.1:0", "--database", f"{folder}/headway.db", *named]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        assert server.stdout is not None
        url = server.stdout.readline().removeprefix("listening on ").strip()
        same = {"split": "train", "dt_s": 0.1, "spacing_m": [20.0] * 40}
        speeds = {name: [10.0] * 40 for name in NAMES[:2]}
        model = Client(url).model()
        model.upload([{"event_id": str(number), **same, **speeds} for number in range(8)], regime="any")
        model.promote(model.train(progress=False).version, reason="measured")
        print("| windows a call | JSON, ms | binary tensors, ms | ratio |\n| --- | --- | --- | --- |")
        for count in [1, 22, 150, 1000]:
            json_ms, binary_ms = compare(url, count, rounds)
            print(f"| {count} | {json_ms:.2f} | {binary_ms:.2f} | {json_ms / binary_ms:.1f} |")
        server.terminate()
        server.wait()


if __name__ == "__main__":
    main()
