"""What a simulation comes to: speeds, flow, how close it was, collisions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from network import MIN_GAP_M, STEP_S, Road

CLOSE_TTC_S = 1.5


class Seen(NamedTuple):
    """A vehicle on a lane that is drawn."""

    time_s: float
    vehicle: str
    place_m: float
    speed_mps: float


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
    arrived: list[str] = field(default_factory=list)
    most_at_once: int = 0
    seen: list[Seen] = field(default_factory=list)
    """For a diagram."""

    def look(self, sumo: Any, step: int) -> None:
        """At the simulation, after a step."""
        now_s = step * STEP_S
        for touched in sumo.simulation.getCollisions():
            self.collisions.add((touched.collider, touched.victim))
        if now_s >= self.road.warm_up_s:
            self.arrived += sumo.simulation.getArrivedIDList()
        if step % round(1 / STEP_S):
            return
        names = sumo.vehicle.getIDList()
        self.most_at_once = max(self.most_at_once, len(names))
        speeds = [sumo.vehicle.getSpeed(name) for name in names]
        for name, speed in zip(names, speeds, strict=True):
            lane = sumo.vehicle.getLaneID(name)
            if lane in self.road.drawn:
                place_m = self.road.drawn[lane] + sumo.vehicle.getLanePosition(name)
                self.seen.append(Seen(now_s, name, place_m, speed))
        if now_s < self.road.warm_up_s or not names:
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

    def figures(self) -> dict[str, float]:
        """For a table."""
        if self.road.name == "ring":
            flows = {"flow, veh/h": float(np.mean(self.speeds)) * self.most_at_once / self.road.length_m * 3600}
        else:
            per_h = 3600 / (self.road.end_s - self.road.warm_up_s)
            ramp = sum(name.startswith("ramp") for name in self.arrived)
            flows = {"flow, veh/h": len(self.arrived) * per_h, "from the ramp, veh/h": ramp * per_h}
        close = sum(ttc < CLOSE_TTC_S for ttc in self.ttc_s)
        return {
            **flows,
            "mean speed, m/s": float(np.mean(self.speeds)),
            "spread of speeds, m/s": float(np.mean(self.spread)),
            "least TTC, s": min(self.ttc_s, default=float("inf")),
            f"TTC < {CLOSE_TTC_S} s, ‰": 1000 * close / max(self.looked, 1),
            "pairs that collided": len(self.collisions),
            "at once": self.most_at_once,
        }
