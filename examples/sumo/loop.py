"""The loop, closed: SUMO's traffic teaches a model, the model drives in SUMO, and what it drove teaches it again.

    pip install ./python eclipse-sumo libsumo
    python examples/sumo/loop.py --binary target/release/headway

Starts a server of its own on a database that goes with it, unless --server names one. Prints what was learned and a
table of each road: SUMO's IDM and Krauss beside the model, within its envelope and without. Exits with 0 only when
every batch was taken, every task made a version, and the model within its envelope touched nobody and drove: SUMO's
own model, which drives where an answer is late, is not what is looked at.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import network
import simulate
from diagrams import draw
from disturbances import one_brakes, wandering
from driver import Driver
from headway import Client, Model, Patience
from measures import Measures
from tables import table

# The defaults, but that we say when to learn, and take what was learned.
SETTINGS = {"schedule": "manual", "promotion": "auto"}
# Short, because a model is asked window by window, and drives on what it knows in its first seconds; see docs/sumo.md.
EVENTS: Mapping[str, Any] = {"min_duration_s": 8.0, "max_duration_s": 8.0, "max_spacing_m": network.SIGHT_M}
DEADLINE_S = 0.25


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


@dataclass(frozen=True)
class Scale:
    """How much of everything."""

    settings: Mapping[str, Any]
    lessons: int
    platoons: int
    motorway_lesson_s: float
    ring_s: float
    motorway_s: float


FULL = Scale({}, lessons=4, platoons=100, motorway_lesson_s=240.0, ring_s=600.0, motorway_s=420.0)
SHORT = Scale(
    {"hidden": 16, "epochs": 6}, lessons=1, platoons=60, motorway_lesson_s=60.0, ring_s=100.0, motorway_s=90.0
)


class Loop:
    """A model that is taught with patience and drives with none, and the folder of the simulations' files."""

    def __init__(self, model: Model, driving: Model, folder: Path, scale: Scale, seeds: range) -> None:
        self.model, self.driving, self.folder, self.scale, self.seeds = model, driving, folder, scale, seeds
        self.horizon = int(model.info().settings["horizon"])
        self.touched = self.driven = self.late = 0
        self.drawn: dict[str, dict[str, Measures]] = {}

    def teach(self, regime: str, files: list[Path]) -> None:
        """Uploads floating-car data, and lets it be learned."""
        for file in files:
            batch = self.model.upload(file, regime=regime, source=file.name, **EVENTS)
            print(f"  {file.name}: {batch.accepted} events of {regime}, {batch.rejected_count} refused", flush=True)
        began = time.perf_counter()
        version = self.model.train()
        took_s = time.perf_counter() - began
        told = ", ".join(
            f"{row.regime} {row.spacing_mse:.3f}" for row in self.model.evaluation(version.version).itertuples()
        )
        print(f"  version {version.version} learned {regime} in {took_s:.0f} s; spacing error, m²: {told}", flush=True)

    def first_lessons(self) -> None:
        """Traffic that SUMO's IDM drives: platoons in every state behind leaders that wander, then a motorway."""
        files = []
        for seed in range(100, 100 + self.scale.lessons):
            road = network.platoons(self.folder, "idm", platoons=self.scale.platoons, seed=seed)
            leaders = range(self.scale.platoons)
            scripts = [part for k in leaders for part in wandering(f"{k}-0", road.end_s, 1000 * seed + k)]
            files.append(self.folder / f"platoons-{seed}.xml.gz")
            simulate.run(road, None, scripts, fcd=files[-1], seed=seed)
        self.teach("platoons", files)
        road = network.motorway(self.folder, "idm", end_s=self.scale.motorway_lesson_s)
        simulate.run(road, None, fcd=self.folder / "motorway.xml.gz", seed=100)
        self.teach("motorway", [self.folder / "motorway.xml.gz"])

    def compare(self, name: str) -> Path:
        """A road by everybody; what our driver drove first, as floating-car data."""
        runs: dict[str, list[dict[str, float]]] = {}
        driven = self.folder / f"{name}-driven.xml.gz"
        for seed in self.seeds:
            for who in ["idm", "krauss", "headway", "headway, no envelope"]:
                first = seed == self.seeds[0]
                fcd = driven if who == "headway" and first else None
                measures, figures = self.drive(name, who, seed, fcd)
                runs.setdefault(who, []).append(figures)
                if first and who != "headway, no envelope":
                    self.drawn.setdefault(name, {})[who] = measures
                if who == "headway":
                    self.touched += len(measures.collisions)
        print(table(runs), flush=True)
        return driven

    def drive(self, name: str, who: str, seed: int, fcd: Path | None) -> tuple[Measures, dict[str, float]]:
        """One road by one of them."""
        ours = who.startswith("headway")
        kind = "headway" if ours else who
        if name == "ring":
            road = network.ring(self.folder, kind, end_s=self.scale.ring_s, seed=seed)
        else:
            road = network.motorway(self.folder, kind, end_s=self.scale.motorway_s)
        driver = Driver(self.driving, self.horizon, road, envelope=who == "headway") if ours else None
        scripts = [one_brakes(seed)] if name == "ring" else []
        measures, took_s = simulate.run(road, driver, scripts, fcd=fcd, seed=seed)
        figures = {**measures.figures(), "× real time": road.end_s / took_s}
        if driver is None:
            return measures, figures
        self.driven += driver.counts.driven
        self.late += driver.counts.fallback
        return measures, {**figures, **driver.counts.figures()}


def main() -> int:
    """Closes the loop."""
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--server", help="a server that runs already; its key is that of HEADWAY_KEY")
    cli.add_argument("--binary", type=Path, default=Path(os.environ.get("HEADWAY_BINARY", "target/release/headway")))
    cli.add_argument("--model", default="sumo", help="a new model's name")
    cli.add_argument("--repeat", type=int, default=1, metavar="N", help="drive each road with N seeds of traffic")
    cli.add_argument("--figures", type=Path, metavar="DIR", help="draw time-space diagrams there (needs matplotlib)")
    cli.add_argument(
        "--short", action="store_true", help="little traffic and a small network: whether it works, not how well"
    )
    arguments = cli.parse_args()
    if arguments.repeat < 1:
        cli.error("--repeat is at least 1")
    if arguments.figures and find_spec("matplotlib") is None:
        cli.error("--figures needs matplotlib")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        if arguments.server:
            return close(arguments, arguments.server, folder)
        with server(arguments.binary, folder) as url:
            return close(arguments, url, folder)


def close(arguments: argparse.Namespace, url: str, folder: Path) -> int:
    """All of it, at this server."""
    scale, seeds = SHORT if arguments.short else FULL, range(1, arguments.repeat + 1)
    with Client(url) as patient, Client(url, timeout_s=DEADLINE_S, patience=Patience(retries=0)) as hasty:
        model = patient.create_model(arguments.model, settings={**SETTINGS, **scale.settings})
        loop = Loop(model, hasty.model(arguments.model), folder, scale, seeds)
        print("SUMO's IDM drives", flush=True)
        loop.first_lessons()
        driven = {}
        for name in ["ring", "motorway"]:
            print(f"\nOn the {name}", flush=True)
            driven[name] = loop.compare(name)
        if arguments.figures:
            arguments.figures.mkdir(parents=True, exist_ok=True)
            draw(loop.drawn, arguments.figures / "sumo.png")
        print("What it drove teaches it", flush=True)
        for name, file in driven.items():
            loop.teach(f"own-{name}", [file])
        print(f"\nAgain, by version {model.info().live}, on the ring", flush=True)
        loop.compare("ring")
    print(f"The loop is closed; within its envelope the model touched {loop.touched} vehicles.")
    print(f"It drove {loop.driven} vehicle steps, and was too late for {loop.late}.")
    return 1 if loop.touched or loop.late >= loop.driven else 0


if __name__ == "__main__":
    sys.exit(main())
