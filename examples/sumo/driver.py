"""Drives every vehicle of a simulation by a Headway server, with one call a step."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from command import command, let_go
from headway import Model, Problem, Unreachable
from merging import COURTESY_MPS2, those_who_join
from network import MIN_GAP_M, SIGHT_M, STEP_S, Road

BUSY = 503
"""What a server answers that has too much to do."""


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
    """By SUMO: on the ramp and the acceleration lane, where following is not all there is to do."""
    courteous: int = 0
    """Of those driven, where room was made for somebody who joins."""
    calls_s: list[float] = field(default_factory=list)

    def figures(self) -> dict[str, float]:
        """For a table."""
        steps = max(self.driven + self.fallback + self.free + self.elsewhere, 1)
        who = {"driven": self.driven, "fallback": self.fallback, "free": self.free, "elsewhere": self.elsewhere}
        what = {"envelope": self.limited, "speed limit": self.capped, "courtesy": self.courteous}
        calls_ms = 1000 * np.asarray(self.calls_s or [np.nan])
        return {
            **{f"{name}, % of steps": 100 * count / steps for name, count in who.items()},
            **{f"{name} acted, % of driven": 100 * count / max(self.driven, 1) for name, count in what.items()},
            "a call, median, ms": float(np.percentile(calls_ms, 50)),
            "a call, p99, ms": float(np.percentile(calls_ms, 99)),
        }


class Pair(NamedTuple):
    """A follower, a leader, and the room between them."""

    follower: str
    leader: str
    spacing_m: float
    """Bumper to bumper."""


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

    def are_long(self, *names: str) -> bool:
        """Whether a window can be filled."""
        return all(name in self.rows and self.known[self.rows[name]] >= self.horizon for name in names)

    def windows(self, pairs: list[Pair]) -> npt.NDArray[np.float32]:
        """Windows `[n, horizon, 4]`.

        Spacings before now are told from both speeds, whoever was the leader then: on one lane
        `s(t-1) = s(t) - dt (leader speed - follower speed)`, means within the step, as SUMO's ballistic update has it.
        """
        own = self.speeds[[self.rows[pair.follower] for pair in pairs]]
        ahead = self.speeds[[self.rows[pair.leader] for pair in pairs]]
        closing = ahead - own
        gained = STEP_S * (closing[:, 1:] + closing[:, :-1]) / 2
        later = np.cumsum(gained[:, ::-1], axis=1)[:, ::-1]
        now = np.asarray([pair.spacing_m for pair in pairs], np.float32)[:, None]
        spacing = np.concatenate([now - later, now], axis=1)
        return np.stack([own, ahead, closing, spacing], axis=2)


class Driver:
    """A server's model at the wheel."""

    def __init__(self, model: Model, horizon: int, road: Road, *, envelope: bool) -> None:
        self.model, self.road, self.envelope = model, road, envelope
        self.histories = Histories(horizon)
        self.commanded: set[str] = set()
        self.counts = Counts()

    def step(self, vehicle: Any) -> None:
        """Commands what every vehicle drives next; `vehicle` is libsumo's or traci's module of that name."""
        lanes = {name: vehicle.getLaneID(name) for name in vehicle.getIDList()}
        speeds = {name: vehicle.getSpeed(name) for name in lanes}
        self.histories.add(speeds)
        pairs = self._pairs(vehicle, lanes)
        joining = self._joining(vehicle, lanes, {pair.follower for pair in pairs})
        try:
            began = time.perf_counter()
            accels = self._ask(pairs, joining)
            self.counts.calls_s.append(time.perf_counter() - began)
        except (Unreachable, Problem) as missing:
            # A refusal is no delay: what is wrong with a request is wrong at every step.
            if isinstance(missing, Problem) and missing.status != BUSY:
                raise
            self.counts.fallback += len(pairs)
            accels = {}
        self.counts.driven += len(accels)
        for name in self.commanded - accels.keys():
            if name in speeds:
                let_go(vehicle, name)
        for name, accel in accels.items():
            wished_mps, allowed_mps = speeds[name] + STEP_S * accel, vehicle.getAllowedSpeed(name)
            self.counts.capped += wished_mps > allowed_mps
            command(vehicle, name, min(max(0.0, wished_mps), max(allowed_mps, speeds[name] - STEP_S)))
        self.commanded = set(accels)

    def _pairs(self, vehicle: Any, lanes: dict[str, str]) -> list[Pair]:
        """Who is driven behind whom."""
        pairs = []
        for name, lane in lanes.items():
            if lane not in self.road.driven_lanes:
                self.counts.elsewhere += 1
                continue
            found = vehicle.getLeader(name, SIGHT_M)
            # What SUMO calls the gap leaves out the follower's minGap.
            if found and found[0] and found[1] + MIN_GAP_M <= SIGHT_M and self.histories.are_long(name, found[0]):
                pairs.append(Pair(name, found[0], found[1] + MIN_GAP_M))
            else:
                self.counts.free += 1
        return pairs

    def _joining(self, vehicle: Any, lanes: dict[str, str], driven: set[str]) -> list[Pair]:
        """For whom those who are driven make room."""
        if self.road.merge is None:
            return []
        near = self.road.merge.through.keys() | self.road.merge.joining.keys()
        places = {name: (lane, vehicle.getLanePosition(name)) for name, lane in lanes.items() if lane in near}
        return [
            Pair(name, joins, spacing_m)
            for name, (joins, spacing_m) in those_who_join(self.road.merge, places).items()
            if name in driven and spacing_m <= SIGHT_M and self.histories.are_long(name, joins)
        ]

    def _ask(self, pairs: list[Pair], joining: list[Pair]) -> dict[str, float]:
        """What everybody drives: behind the leader, and with comfort behind whoever joins."""
        if not pairs:
            return {}
        predicted = self.model.predict(self.histories.windows(pairs + joining))
        self.counts.limited += int(predicted.limited[: len(pairs)].sum())
        answers = (predicted.accel_mps2 if self.envelope else predicted.raw_accel_mps2).tolist()
        accels = {pair.follower: accel for pair, accel in zip(pairs, answers, strict=False)}
        for pair, accel in zip(joining, answers[len(pairs) :], strict=True):
            polite = max(accel, -COURTESY_MPS2)
            if polite < accels[pair.follower]:
                accels[pair.follower] = polite
                self.counts.courteous += 1
        return accels
