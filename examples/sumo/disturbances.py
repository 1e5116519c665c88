"""Drivers who do not follow: what begins waves, and what shows a model how to follow through them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from command import command, let_go
from network import FREE_MPS, STEP_S


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
            command(vehicle, self.vehicle, now_mps + min(max(self.to_mps - now_mps, -most), most))
        elif 0 <= now_s - self.until_s < STEP_S:
            let_go(vehicle, self.vehicle)


def one_brakes(seed: int) -> Scripted:
    """For comparisons on the ring: after a minute or so one vehicle brakes to a stop."""
    random = np.random.default_rng(seed)
    from_s = 60.0 + random.uniform(0.0, 5.0)
    return Scripted(f"v{random.integers(22)}", from_s, from_s + 4.0, 3.0, 0.0)


def wandering(leader: str, end_s: float, seed: int) -> tuple[Scripted, ...]:
    """The first of a platoon goes from speed to speed, now and then to a stop, gently or hard."""
    random = np.random.default_rng(seed)
    script, now_s = [], 0.1
    while now_s < end_s:
        until_s = now_s + random.uniform(3.0, 15.0)
        to_mps = 0.0 if random.random() < 0.2 else FREE_MPS * random.random() ** 2
        script.append(Scripted(leader, now_s, until_s, random.uniform(0.5, 6.0), to_mps))
        now_s = until_s
    return tuple(script)
