"""Who is at the wheel of a vehicle of SUMO: a command, or SUMO's own models."""

from __future__ import annotations

from typing import Any

# Of SUMO's speed modes: everything off, so that what is commanded is driven, and collisions are ours; everything on.
COMMANDED, OWN = 32, 31


def command(vehicle: Any, name: str, speed_mps: float) -> None:
    """Lets it drive at this speed from the next step on; `vehicle` is libsumo's or traci's module of that name."""
    vehicle.setSpeedMode(name, COMMANDED)
    vehicle.setSpeed(name, speed_mps)


def let_go(vehicle: Any, name: str) -> None:
    """Lets SUMO drive it again."""
    vehicle.setSpeedMode(name, OWN)
    vehicle.setSpeed(name, -1)
