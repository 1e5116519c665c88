"""Drives every vehicle of a simulation by a Headway server, with one call a step."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from headway import HeadwayError, Model
from network import MIN_GAP_M, STEP_S

SIGHT_M = 100.0
"""Leaders further ahead are none."""

# Of SUMO's speed modes: everything off, so that what is commanded is driven, and collisions are ours;
# and everything on.
COMMANDED, OWN = 32, 31


@dataclass
class Counts:
    """Vehicle steps, by who drove, and what a step took."""

    driven: int = 0
    """By the server."""
    limited: int = 0
    """Of these, where the envelope acted."""
    capped: int = 0
    """Where the road allows no more than was wished."""
    fallback: int = 0
    """By SUMO because no answer came in time."""
    free: int = 0
    """By SUMO: nobody in sight ahead, or too short a past."""
    elsewhere: int = 0
    """By SUMO: on the ramp, and on the two lanes where it joins, where following is not all there is to do."""
    calls_s: list[float] = field(default_factory=list)


class Histories:
    """The last speeds of every vehicle, the newest last."""

    def __init__(self, horizon: int) -> None:
        self.horizon = horizon
        self.rows: dict[str, int] = {}
        self.speeds = np.zeros((0, horizon), np.float32)
        self.known = np.zeros(0, np.int64)
        self._unused: list[int] = []

    def add(self, speeds: dict[str, float]) -> None:
        """What everybody drives now. Who is not there any more is forgotten."""
        for gone in self.rows.keys() - speeds.keys():
            self._unused.append(self.rows.pop(gone))
        for come in speeds.keys() - self.rows.keys():
            if not self._unused:
                count = len(self.speeds)
                self.speeds = np.vstack([self.speeds, np.zeros((count + 8, self.horizon), np.float32)])
                self.known = np.append(self.known, np.zeros(count + 8, np.int64))
                self._unused = list(range(count, len(self.speeds)))
            self.rows[come] = self._unused.pop()
            self.known[self.rows[come]] = 0
        rows = np.fromiter((self.rows[name] for name in speeds), np.int64, len(speeds))
        self.speeds[rows] = np.roll(self.speeds[rows], -1, axis=1)
        self.speeds[rows, -1] = np.fromiter(speeds.values(), np.float32, len(speeds))
        self.known[rows] += 1

    def is_long(self, name: str) -> bool:
        """Whether a window can be filled."""
        return bool(self.known[self.rows[name]] >= self.horizon)

    def windows(self, followers: list[str], leaders: list[str], spacings_m: list[float]) -> npt.NDArray[np.float32]:
        """Windows `[n, horizon, 4]`.

        Spacings before now are told from both speeds, whoever was the leader then: on one lane
        `s(t-1) = s(t) - dt (leader speed - follower speed)`, means within the step, as SUMO's ballistic update has it.
        """
        own = self.speeds[[self.rows[name] for name in followers]]
        ahead = self.speeds[[self.rows[name] for name in leaders]]
        closing = ahead - own
        gained = STEP_S * (closing[:, 1:] + closing[:, :-1]) / 2
        later = np.cumsum(gained[:, ::-1], axis=1)[:, ::-1]
        now = np.asarray(spacings_m, np.float32)[:, None]
        spacing = np.concatenate([now - later, now], axis=1)
        return np.stack([own, ahead, closing, spacing], axis=2)


class Driver:
    """A server's model at the wheel."""

    def __init__(self, model: Model, horizon: int, driven_lanes: frozenset[str], *, envelope: bool) -> None:
        self.model, self.lanes, self.envelope = model, driven_lanes, envelope
        self.histories = Histories(horizon)
        self.commanded: set[str] = set()
        self.counts = Counts()

    def step(self, vehicle: Any) -> None:
        """Commands what every vehicle drives next; `vehicle` is libsumo's or traci's module of that name."""
        names = list(vehicle.getIDList())
        speeds = {name: vehicle.getSpeed(name) for name in names}
        self.histories.add(speeds)
        followers, leaders, spacings = self._pairs(vehicle, names)
        try:
            began = time.perf_counter()
            accels = self._ask(followers, leaders, spacings)
            self.counts.calls_s.append(time.perf_counter() - began)
        except HeadwayError:
            self.counts.fallback += len(followers)
            followers, accels = [], np.zeros(0)
        for name in self.commanded - set(followers):
            if name in speeds:
                vehicle.setSpeedMode(name, OWN)
                vehicle.setSpeed(name, -1)
        for name, accel in zip(followers, accels.tolist(), strict=True):
            if name not in self.commanded:
                vehicle.setSpeedMode(name, COMMANDED)
            wished_mps, allowed_mps = speeds[name] + STEP_S * accel, vehicle.getAllowedSpeed(name)
            self.counts.capped += wished_mps > allowed_mps
            vehicle.setSpeed(name, min(max(0.0, wished_mps), max(allowed_mps, speeds[name] - STEP_S)))
        self.commanded = set(followers)
        self.counts.driven += len(followers)

    def _pairs(self, vehicle: Any, names: list[str]) -> tuple[list[str], list[str], list[float]]:
        """Who is driven behind whom, and the net spacing."""
        followers, leaders, spacings = [], [], []
        for name in names:
            if vehicle.getLaneID(name) not in self.lanes:
                self.counts.elsewhere += 1
                continue
            found = vehicle.getLeader(name, SIGHT_M)
            if not found or not found[0] or found[0] not in self.histories.rows or found[1] > SIGHT_M:
                self.counts.free += 1
            elif self.histories.is_long(name) and self.histories.is_long(found[0]):
                followers.append(name)
                leaders.append(found[0])
                # What SUMO calls the gap leaves out the follower's minGap.
                spacings.append(found[1] + MIN_GAP_M)
            else:
                self.counts.free += 1
        return followers, leaders, spacings

    def _ask(self, followers: list[str], leaders: list[str], spacings_m: list[float]) -> npt.NDArray[np.float32]:
        if not followers:
            return np.zeros(0, np.float32)
        windows = self.histories.windows(followers, leaders, spacings_m)
        predicted = self.model.predict(windows)
        self.counts.limited += int(predicted.limited.sum())
        return predicted.accel_mps2 if self.envelope else predicted.raw_accel_mps2
