"""The loop, closed: SUMO's traffic teaches a model, the model drives in SUMO, and what it drove teaches it again.

    pip install ./python eclipse-sumo libsumo
    python examples/sumo/loop.py --binary target/release/headway

Starts a server of its own on a database that goes with it, unless --server names one. Prints what was learned and a
table of each road: SUMO's IDM and Krauss beside the model, within its envelope and without. Exits with 0 only when
every batch was taken, every task made a version, and the model within its envelope touched nobody.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import network
import numpy as np
import simulate
from disturbances import ONE_BRAKES, wandering_leader
from driver import Driver
from headway import Client, Model, Patience

# Windows that are encoded anew at every step, because that is how a server is asked here; see docs/sumo.md.
SETTINGS = {"memory": "window", "features": "raw", "schedule": "manual", "promotion": "auto", "epochs": 10}
DEADLINE_S = 0.25
EVENT_S = 20.0


@contextmanager
def server(binary: Path, folder: Path) -> Iterator[str]:
    """A server of our own."""
    command = [str(binary), "--listen", "127.0.0.1:0", "--database", str(folder / "headway.db")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    try:
        yield process.stdout.readline().removeprefix("listening on ").strip()
    finally:
        process.terminate()
        process.wait()


class Loop:
    """A model that is taught with patience and drives with none, and the folder of the simulations' files."""

    def __init__(self, model: Model, driving: Model, folder: Path, short: bool) -> None:
        self.model, self.driving, self.folder, self.short = model, driving, folder, short
        self.horizon = int(model.info().settings["horizon"])
        self.touched = 0

    def teach(self, regime: str, files: list[Path]) -> None:
        """Uploads floating-car data, and lets it be learned."""
        for file in files:
            batch = self.model.upload(file, regime=regime, source=file.name, max_duration_s=EVENT_S)
            print(f"  {file.name}: {batch.accepted} events of {regime}, {batch.rejected_count} refused", flush=True)
        version = self.model.train()
        told = self.model.evaluation(version.version)
        print(f"  version {version.version} has learned {regime}; spacing error, m²: ", end="")
        print(", ".join(f"{row.regime} {row.spacing_mse:.2f}" for row in told.itertuples()), flush=True)

    def first_lessons(self) -> None:
        """Traffic that SUMO's IDM drives: a platoon behind leaders that wander, then a motorway."""
        files = []
        for seed in (1,) if self.short else (1, 2, 3, 4):
            road = network.platoon(self.folder, "idm", end_s=120.0 if self.short else 300.0)
            files.append(self.folder / f"platoon-{seed}.xml.gz")
            simulate.run(road, None, wandering_leader(road.end_s, 15.0, seed), fcd=files[-1], seed=seed)
        self.teach("platoon", files)
        road = network.motorway(self.folder, "idm", end_s=60.0 if self.short else 200.0)
        simulate.run(road, None, fcd=self.folder / "motorway.xml.gz")
        self.teach("motorway", [self.folder / "motorway.xml.gz"])

    def compare(self, name: str) -> Path:
        """A road by everybody; what our driver drove, as floating-car data."""
        rows, driven = {}, self.folder / f"{name}-driven.xml.gz"
        for who in ["idm", "krauss", "headway", "headway, no envelope"]:
            ours = who.startswith("headway")
            kind = "headway" if ours else who
            end_s = {"ring": 120.0, "motorway": 90.0}[name] if self.short else {"ring": 600.0, "motorway": 300.0}[name]
            road = getattr(network, name)(self.folder, kind, end_s=end_s)
            driver = None
            if ours:
                driver = Driver(self.driving, self.horizon, road.driven_lanes, envelope=who == "headway")
            scripts = ONE_BRAKES if name == "ring" else ()
            fcd = driven if who == "headway" else None
            measures, took_s = simulate.run(road, driver, scripts, fcd=fcd)
            rows[who] = {
                **measures.row(),
                "at once": str(measures.most_at_once),
                "× real time": f"{end_s / took_s:.0f}",
            }
            if driver is not None:
                rows[who].update(shares(driver))
            if who == "headway":
                self.touched += len(measures.collisions)
        print(table(rows), flush=True)
        return driven


def shares(driver: Driver) -> dict[str, str]:
    """Who drove, of all vehicle steps."""
    counts = driver.counts
    steps = counts.driven + counts.fallback + counts.free + counts.elsewhere
    share = {name: f"{100 * getattr(counts, name) / steps:.2f}" for name in ["driven", "fallback", "free", "elsewhere"]}
    calls_ms = 1000 * np.asarray(counts.calls_s)
    return {
        **{f"{name}, % of steps": value for name, value in share.items()},
        "envelope acted, % of driven": f"{100 * counts.limited / max(counts.driven, 1):.2f}",
        "speed limit acted, % of driven": f"{100 * counts.capped / max(counts.driven, 1):.2f}",
        "a call, median / p99, ms": f"{np.median(calls_ms):.1f} / {np.quantile(calls_ms, 0.99):.1f}",
    }


def table(rows: dict[str, dict[str, str]]) -> str:
    """In Markdown, a column for each driver."""
    names = list(dict.fromkeys(name for row in rows.values() for name in row))
    lines = ["", "| | " + " | ".join(rows) + " |", "| --- " * (len(rows) + 1) + "|"]
    lines += [f"| {name} | " + " | ".join(row.get(name, "–") for row in rows.values()) + " |" for name in names]
    return "\n".join([*lines, ""])


def main() -> int:
    """Closes the loop."""
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--server", help="a server that runs already; its key is that of HEADWAY_KEY")
    cli.add_argument("--binary", type=Path, default=Path(os.environ.get("HEADWAY_BINARY", "target/release/headway")))
    cli.add_argument("--model", default="sumo", help="a new model's name")
    cli.add_argument(
        "--short", action="store_true", help="little traffic and a small network: whether it works, not how well"
    )
    arguments = cli.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        if arguments.server:
            return close(arguments, arguments.server, folder)
        with server(arguments.binary, folder) as url:
            return close(arguments, url, folder)


def close(arguments: argparse.Namespace, url: str, folder: Path) -> int:
    """All of it, at this server."""
    settings = {**SETTINGS, **({"hidden": 16, "epochs": 6} if arguments.short else {})}
    with Client(url) as patient, Client(url, timeout_s=DEADLINE_S, patience=Patience(retries=0)) as hasty:
        model = patient.create_model(arguments.model, settings=settings)
        loop = Loop(model, hasty.model(arguments.model), folder, arguments.short)
        print("SUMO's IDM drives", flush=True)
        loop.first_lessons()
        driven = {}
        for name in ["ring", "motorway"]:
            print(f"\nOn the {name}", flush=True)
            driven[name] = loop.compare(name)
        print("What it drove teaches it", flush=True)
        for name, file in driven.items():
            loop.teach(f"own-{name}", [file])
        print(f"\nAgain, by version {model.info().live}, on the ring", flush=True)
        loop.compare("ring")
    print(f"The loop is closed; within its envelope the model touched {loop.touched} vehicles.")
    return 1 if loop.touched else 0


if __name__ == "__main__":
    sys.exit(main())
