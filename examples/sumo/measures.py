"""What a simulation comes to: speeds, flow, how close it was, collisions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from network import MIN_GAP_M, STEP_S, Road

WARM_UP_S = 60.0
CLOSE_TTC_S = 1.5


@dataclass
class Measures:
    """Taken once a second, collisions at every step."""

    road: Road
    speeds: list[float] = field(default_factory=list)
    spread: list[float] = field(default_factory=list)
    """Standard deviation of speeds over the vehicles, each second."""
    ttc_s: list[float] = field(default_factory=list)
    """Times to collision of those who close in."""
    looked: int = 0
    collisions: set[tuple[str, str]] = field(default_factory=set)
    """Pairs that touched."""
    arrived: int = 0
    most_at_once: int = 0
    positions: list[tuple[float, str, float, float]] = field(default_factory=list)
    """Time, vehicle, distance driven, speed: for a diagram."""

    def look(self, sumo: Any, step: int) -> None:
        """At the simulation, after a step."""
        now_s = step * STEP_S
        for touched in sumo.simulation.getCollisions():
            self.collisions.add((touched.collider, touched.victim))
        if now_s >= WARM_UP_S:
            self.arrived += sumo.simulation.getArrivedNumber()
        if step % round(1 / STEP_S):
            return
        names = sumo.vehicle.getIDList()
        self.most_at_once = max(self.most_at_once, len(names))
        speeds = [sumo.vehicle.getSpeed(name) for name in names]
        for name, speed in zip(names, speeds, strict=True):
            self.positions.append((now_s, name, sumo.vehicle.getDistance(name), speed))
        if now_s < WARM_UP_S or not names:
            return
        self.speeds += speeds
        self.spread.append(float(np.std(speeds)))
        for name, speed in zip(names, speeds, strict=True):
            found = sumo.vehicle.getLeader(name, 100.0)
            if found and found[0]:
                self.looked += 1
                closing = speed - sumo.vehicle.getSpeed(found[0])
                if closing > 0.05:
                    self.ttc_s.append((found[1] + MIN_GAP_M) / closing)

    def row(self) -> dict[str, str]:
        """For a table."""
        span_s = self.road.end_s - WARM_UP_S
        if self.road.name == "ring":
            vehicles = self.most_at_once
            flow_per_h = float(np.mean(self.speeds)) * vehicles / self.road.length_m * 3600
        else:
            flow_per_h = self.arrived / span_s * 3600
        close = sum(ttc < CLOSE_TTC_S for ttc in self.ttc_s)
        return {
            "flow, veh/h": f"{flow_per_h:.0f}",
            "mean speed, m/s": f"{np.mean(self.speeds):.2f}",
            "spread of speeds, m/s": f"{np.mean(self.spread):.2f}",
            "least TTC, s": f"{min(self.ttc_s, default=float('inf')):.1f}",
            f"TTC < {CLOSE_TTC_S} s, ‰": f"{1000 * close / max(self.looked, 1):.2f}",
            "pairs that collided": str(len(self.collisions)),
        }
