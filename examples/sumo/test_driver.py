"""Windows against SUMO itself, and what happens when no answer comes.

Needs eclipse-sumo, libsumo and headway-client.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import libsumo
import network
import numpy as np
import pytest
import simulate
from disturbances import Scripted, wandering
from driver import Driver, Histories, Pair
from headway import Problem, Unreachable
from merging import COURTESY_MPS2

HORIZON = 10


class Answers:
    """A model that answers with these accelerations."""

    def __init__(self, accels_mps2: list[float]) -> None:
        self.accels_mps2 = np.array(accels_mps2, np.float32)

    def predict(self, windows: np.ndarray[Any, Any]) -> Any:
        assert len(windows) == len(self.accels_mps2)
        unlimited = np.zeros(len(windows), bool)
        return SimpleNamespace(accel_mps2=self.accels_mps2, raw_accel_mps2=self.accels_mps2, limited=unlimited)


class Stub:
    """A model that answers with the same acceleration, or not at all."""

    def __init__(self, accel_mps2: float | None) -> None:
        self.accel_mps2 = accel_mps2
        self.asked: list[np.ndarray[Any, Any]] = []

    def predict(self, windows: np.ndarray[Any, Any]) -> Any:
        self.asked.append(windows)
        if self.accel_mps2 is None:
            raise Unreachable("too late")
        accel = np.full(len(windows), self.accel_mps2, np.float32)
        return SimpleNamespace(accel_mps2=accel, raw_accel_mps2=accel, limited=np.zeros(len(windows), bool))


def test_windows_are_what_sumo_saw(tmp_path: Path) -> None:
    road = network.platoons(tmp_path, "idm", platoons=1, vehicles=5, end_s=40.0)
    histories, seen = Histories(HORIZON), []

    class Watching:
        def step(self, vehicle: Any) -> None:
            names = list(vehicle.getIDList())
            histories.add({name: vehicle.getSpeed(name) for name in names})
            # Bumper to bumper, by positions alone.
            at = {name: vehicle.getLanePosition(name) for name in names}
            gaps = {f"0-{k}": at[f"0-{k - 1}"] - network.VEHICLE_LENGTH_M - at[f"0-{k}"] for k in range(1, 5)}
            seen.append(gaps)
            for follower, gap_m in gaps.items():
                found = vehicle.getLeader(follower, 1000.0)
                assert found[0] == f"0-{int(follower[2:]) - 1}"
                assert abs(found[1] + network.MIN_GAP_M - gap_m) < 1e-6, "SUMO's gap leaves out minGap"
                if histories.are_long(follower, found[0]) and len(seen) > HORIZON:
                    (window,) = histories.windows([Pair(follower, found[0], gap_m)])
                    past = [gaps[follower] for gaps in seen[-HORIZON:]]
                    np.testing.assert_allclose(window[:, 3], past, atol=2e-3)
                    assert window[-1, 0] == np.float32(vehicle.getSpeed(follower))

    simulate.run(road, Watching(), wandering("0-0", 40.0, 3))  # type: ignore[arg-type]
    assert len(seen) == 400


def test_who_goes_is_forgotten_and_who_comes_begins_anew() -> None:
    histories = Histories(3)
    for step in range(4):
        histories.add({"a": step, "b": 10.0 + step})
    assert histories.are_long("a", "b") and histories.windows([Pair("a", "b", 5.0)]).shape == (1, 3, 4)
    histories.add({"b": 14.0, "c": 1.0})
    assert "a" not in histories.rows and not histories.are_long("b", "c") and histories.are_long("b")
    for step in range(20):
        histories.add({f"{step}-{number}": 1.0 for number in range(step)})
    assert len(histories.speeds) < 64, "rows are used again"


def test_without_an_answer_sumo_drives(tmp_path: Path) -> None:
    road = network.ring(tmp_path, "headway", end_s=30.0)
    driver = Driver(Stub(None), HORIZON, road, envelope=True)  # type: ignore[arg-type]
    measures, _ = simulate.run(road, driver)
    assert driver.counts.driven == 0 and driver.counts.fallback > 6000 and not measures.collisions
    # Every vehicle is asked for from the moment that its past and its leader's fill a window.
    assert driver.counts.fallback + driver.counts.free == 22 * 300
    assert driver.counts.figures()["driven, % of steps"] == 0


def test_what_is_answered_is_driven(tmp_path: Path) -> None:
    road = network.platoons(tmp_path, "headway", platoons=1, vehicles=3, end_s=12.0)
    driver = Driver(Stub(0.0), HORIZON, road, envelope=True)  # type: ignore[arg-type]
    measures, _ = simulate.run(road, driver)
    speeds = {
        name: [seen.speed_mps for seen in measures.seen if seen.vehicle == name] for name in ["0-0", "0-1", "0-2"]
    }
    # Whoever follows keeps the speed at which it was taken over; the first, who follows nobody, goes on.
    assert len(set(np.round(speeds["0-1"][3:], 4))) == 1 and speeds["0-0"][-1] > speeds["0-0"][3]
    assert not libsumo.isLoaded()


def test_room_is_made_with_comfort_and_safety_comes_first(tmp_path: Path) -> None:
    road = network.motorway(tmp_path, "headway", end_s=60.0)
    driver = Driver(Stub(-5.0), HORIZON, road, envelope=True)  # type: ignore[arg-type]
    driver.histories.add({"a": 20.0, "b": 20.0, "joins": 20.0})
    behind, joining = Pair("a", "b", 30.0), Pair("a", "joins", 10.0)
    assert driver._ask([behind], [joining]) == {"a": -5.0}
    driver.model = Answers([1.0, -5.0])  # type: ignore[assignment]
    assert driver._ask([behind], [joining]) == {"a": -COURTESY_MPS2} and driver.counts.courteous == 1
    driver.model = Answers([1.0, 2.0])  # type: ignore[assignment]
    assert driver._ask([behind], [joining]) == {"a": 1.0} and driver.counts.courteous == 1


def test_whoever_touches_is_seen(tmp_path: Path) -> None:
    road = network.platoons(tmp_path, "headway", platoons=1, vehicles=3, end_s=30.0)
    driver = Driver(Stub(0.5), HORIZON, road, envelope=True)  # type: ignore[arg-type]
    measures, _ = simulate.run(road, driver, [Scripted("0-0", 2.0, 30.0, 6.0, 0.0)])
    assert ("0-1", "0-0") in measures.collisions and measures.figures()["pairs that collided"] >= 1


def test_a_refusal_is_no_delay(tmp_path: Path) -> None:
    road = network.ring(tmp_path, "headway", end_s=5.0)

    class Refused:
        def __init__(self, status: int) -> None:
            self.status = status

        def predict(self, windows: np.ndarray[Any, Any]) -> Any:
            raise Problem(self.status, {"code": "refused", "detail": "no"})

    with pytest.raises(Problem):
        simulate.run(road, Driver(Refused(404), HORIZON, road, envelope=True))
    busy = Driver(Refused(503), HORIZON, road, envelope=True)
    simulate.run(road, busy)
    assert busy.counts.fallback > 0 and busy.counts.driven == 0
