"""One simulation: a road, and who drives."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from disturbances import Scripted
from driver import Driver
from measures import Measures
from network import SIGHT_M, STEP_S, Road


def run(
    road: Road, driver: Driver | None, scripts: Sequence[Scripted] = (), *, fcd: Path | None = None, seed: int = 7
) -> tuple[Measures, float]:
    """Simulates, by SUMO's own model where there is no driver; what was measured, and seconds that it took."""
    import libsumo as sumo

    options: list[Any] = ["sumo", "-n", road.network, "-r", road.routes, "--step-length", STEP_S, "--seed", seed]
    options += ["--step-method.ballistic", "true", "--collision.action", "warn", "--collision.mingap-factor", 0]
    options += ["--time-to-teleport", -1, "--no-step-log", "true", "--no-warnings", "true", "--default.speeddev", 0]
    if fcd is not None:
        options += ["--fcd-output", fcd, "--fcd-output.max-leader-distance", SIGHT_M]
    sumo.start([str(option) for option in options])
    measures = Measures(road)
    began = time.perf_counter()
    try:
        for step in range(1, round(road.end_s / STEP_S) + 1):
            for script in scripts:
                script.step(sumo.vehicle, step)
            sumo.simulationStep()
            if driver is not None:
                driver.step(sumo.vehicle)
            measures.look(sumo, step)
    finally:
        took_s = time.perf_counter() - began
        sumo.close()
    return measures, took_s
