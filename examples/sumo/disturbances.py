"""Drivers who do not follow: what begins waves, and what shows a model how to follow through them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from network import STEP_S


@dataclass(frozen=True)
class Scripted:
    """A vehicle that goes to a speed at a rate, and holds it; SUMO drives it before and after."""

    vehicle: str
    from_s: float
    until_s: float
    rate_mps2: float
    to_mps: float

    def step(self, vehicle: Any, step: int) -> None:
        """Before the simulation's step that ends at `step`."""
        now_s = step * STEP_S
        if self.from_s <= now_s < self.until_s:
            now_mps, most = vehicle.getSpeed(self.vehicle), self.rate_mps2 * STEP_S
            vehicle.setSpeed(self.vehicle, now_mps + min(max(self.to_mps - now_mps, -most), most))
        elif 0 <= now_s - self.until_s < STEP_S:
            vehicle.setSpeed(self.vehicle, -1)


ONE_BRAKES = (Scripted("v0", 60.0, 64.0, 3.0, 0.0),)
"""For comparisons on the ring: one vehicle brakes to a stop."""


def wandering_leader(end_s: float, most_mps: float, seed: int) -> tuple[Scripted, ...]:
    """The first of a platoon goes from speed to speed, now and then to a stop, gently or hard."""
    random = np.random.default_rng(seed)
    script, now_s = [], 5.0
    while now_s < end_s:
        until_s = now_s + random.uniform(5.0, 20.0)
        to_mps = 0.0 if random.random() < 0.2 else random.uniform(1.0, most_mps)
        script.append(Scripted("v0", now_s, until_s, random.uniform(0.5, 4.0), to_mps))
        now_s = until_s
    return tuple(script)
