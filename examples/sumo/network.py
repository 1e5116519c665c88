"""Roads and traffic: a ring, and a motorway with an on-ramp, as SUMO's files."""

from __future__ import annotations

import math
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import sumo

STEP_S = 0.1
VEHICLE_LENGTH_M = 5.0
MIN_GAP_M = 2.0
SIGHT_M = 200.0
"""Leaders further ahead are none."""
FREE_MPS = 30.0
"""What a driver would drive alone, on every road: a model is not told of limits."""

TYPES = {
    "idm": 'carFollowModel="IDM" accel="1.2" decel="2.0" tau="1.0" delta="4"',
    "krauss": 'carFollowModel="Krauss" accel="2.6" decel="4.5" tau="1.0" sigma="0.5"',
}


@dataclass(frozen=True)
class Merge:
    """Two streams that meet: their lanes, and where each begins, in m from where they begin to run side by side."""

    through: dict[str, float]
    joining: dict[str, float]


@dataclass(frozen=True)
class Road:
    """A network, who drives on it, and for how long."""

    name: str
    network: Path
    routes: Path
    end_s: float
    length_m: float
    """Of one lane of what is measured."""
    driven_lanes: frozenset[str]
    """Where a driver of ours may drive; elsewhere SUMO's own does."""
    warm_up_s: float
    """Before anything is measured."""
    drawn: dict[str, float]
    """For a diagram: lanes one after another, and where each begins, m."""
    merge: Merge | None = None


def vehicle_type(model: str) -> str:
    """The one type of all vehicles. What drives by a server is SUMO's IDM where nobody else drives."""
    kind = TYPES.get(model, TYPES["idm"])
    return (
        f'<vType id="car" {kind} length="{VEHICLE_LENGTH_M}" minGap="{MIN_GAP_M}" maxSpeed="{FREE_MPS}" '
        'speedDev="0" emergencyDecel="9"/>'
    )


def _built(folder: Path, name: str, nodes: str, edges: str, *options: str) -> Path:
    for kind, content in [("nod", f"<nodes>{nodes}</nodes>"), ("edg", f"<edges>{edges}</edges>")]:
        (folder / f"{name}.{kind}.xml").write_text(content)
    network = folder / f"{name}.net.xml"
    command = [
        Path(sumo.SUMO_HOME) / "bin" / "netconvert",
        "-n",
        folder / f"{name}.nod.xml",
        "-e",
        folder / f"{name}.edg.xml",
    ]
    subprocess.run([*map(str, command), "-o", str(network), *options], check=True, capture_output=True)
    return network


def ring(
    folder: Path,
    model: str,
    *,
    vehicles: int = 22,
    length_m: float = 260.0,
    end_s: float = 600.0,
    seed: int = 1,
) -> Road:
    """A single lane that closes on itself (Sugiyama et al. 2008), on which all begin at rest, about evenly spread."""
    arcs, points = 4, 24
    radius = length_m / (2 * math.pi)

    def at(turn: float) -> str:
        return f"{radius * math.cos(2 * math.pi * turn):.3f},{radius * math.sin(2 * math.pi * turn):.3f}"

    nodes = "".join(
        f'<node id="n{k}" x="{at(k / arcs).split(",")[0]}" y="{at(k / arcs).split(",")[1]}"/>' for k in range(arcs)
    )
    edges = ""
    for k in range(arcs):
        shape = " ".join(at((k + part / points) / arcs) for part in range(points + 1))
        edges += (
            f'<edge id="e{k}" from="n{k}" to="n{(k + 1) % arcs}" numLanes="1" speed="{FREE_MPS}" shape="{shape}" '
            f'length="{length_m / arcs}"/>'
        )
    network = _built(folder, f"ring-{model}", nodes, edges, "--no-internal-links", "true", "--no-turnarounds", "true")
    laps = math.ceil(end_s * FREE_MPS / length_m) + 1
    departures, random = "", np.random.default_rng(seed)
    for number in range(vehicles):
        position_m = (number * length_m / vehicles + random.uniform(0.0, 2.0)) % length_m
        first = int(position_m // (length_m / arcs))
        route = " ".join(f"e{(first + k) % arcs}" for k in range(arcs))
        departures += (
            f'<vehicle id="v{number}" type="car" depart="0" departSpeed="0" '
            f'departPos="{position_m % (length_m / arcs):.3f}">'
            f'<route edges="{route}" repeat="{laps}"/></vehicle>'
        )
    routes = folder / f"ring-{model}.rou.xml"
    routes.write_text(f"<routes>{vehicle_type(model)}{departures}</routes>")
    drawn = {f"e{k}_0": k * length_m / arcs for k in range(arcs)}
    return Road("ring", network, routes, end_s, length_m, frozenset(drawn), min(60.0, end_s / 2), drawn)


def platoons(
    folder: Path, model: str, *, platoons: int = 100, vehicles: int = 5, end_s: float = 30.0, seed: int = 1
) -> Road:
    """Lanes with a platoon each, whose vehicles begin at any speed and any spacing behind one that drives by a script.

    What a model can learn to follow from: traffic by itself shows few speeds with each spacing.
    """
    random, length_m = np.random.default_rng(seed), 3000.0
    nodes, edges, departures = "", "", ""
    for lane in range(platoons):
        nodes += f'<node id="a{lane}" x="0" y="{20 * lane}"/><node id="b{lane}" x="{length_m}" y="{20 * lane}"/>'
        edges += f'<edge id="lane{lane}" from="a{lane}" to="b{lane}" numLanes="1" speed="{FREE_MPS}"/>'
        at_m, ahead_mps = 1500.0, FREE_MPS * random.random() ** 1.5
        for number in range(vehicles):
            if number:
                speed_mps = min(max(ahead_mps + random.normal(0.0, 4.0), 0.0), FREE_MPS)
                braking_m = max(speed_mps**2 - ahead_mps**2, 0.0) / (2 * 3.0)
                at_m -= VEHICLE_LENGTH_M + MIN_GAP_M + braking_m + random.gamma(1.5, 1.0) * (2.0 + speed_mps)
                ahead_mps = speed_mps
            departures += (
                f'<vehicle id="{lane}-{number}" type="car" depart="0" departPos="{at_m:.2f}" '
                f'departSpeed="{ahead_mps:.2f}" insertionChecks="none"><route edges="lane{lane}"/></vehicle>'
            )
    network = _built(folder, f"platoons-{model}", nodes, edges)
    routes = folder / f"platoons-{model}.rou.xml"
    routes.write_text(f"<routes>{vehicle_type(model)}{departures}</routes>")
    lanes = frozenset(f"lane{lane}_0" for lane in range(platoons))
    return Road("platoons", network, routes, end_s, length_m, lanes, 0.0, {"lane0_0": 0.0})


def motorway(
    folder: Path, model: str, *, end_s: float = 300.0, main_per_h: float = 3200.0, ramp_per_h: float = 600.0
) -> Road:
    """Two lanes of 3 km with an on-ramp after the first, and an acceleration lane of 250 m; SUMO drives on both."""
    ramp_m = 400.0
    xs = {"a": 0, "b": 1000, "c": 1250, "d": 3000}
    nodes = "".join(f'<node id="{name}" x="{x}" y="0"/>' for name, x in xs.items())
    nodes += '<node id="r0" x="600" y="-60"/>'
    edges = "".join(
        f'<edge id="{name}" from="{begin}" to="{end}" numLanes="{lanes}" speed="{speed}" length="{length_m}"/>'
        for name, begin, end, lanes, speed, length_m in [
            ("before", "a", "b", 2, FREE_MPS, 1000.0),
            ("merge", "b", "c", 3, FREE_MPS, 250.0),
            ("after", "c", "d", 2, FREE_MPS, 1750.0),
            ("ramp", "r0", "b", 1, 22.0, ramp_m),
        ]
    )
    connections = folder / f"motorway-{model}.con.xml"
    ties = [
        ("before", 0, "merge", 1),
        ("before", 1, "merge", 2),
        ("ramp", 0, "merge", 0),
        ("merge", 1, "after", 0),
        ("merge", 2, "after", 1),
    ]
    connections.write_text(
        "<connections>"
        + "".join(f'<connection from="{f}" fromLane="{fl}" to="{t}" toLane="{tl}"/>' for f, fl, t, tl in ties)
        + "</connections>"
    )
    network = _built(folder, f"motorway-{model}", nodes, edges, "-x", str(connections), "--no-internal-links", "true")
    flows = "".join(
        f'<flow id="{name}" type="car" begin="0" end="{end_s}" period="exp({per_h / 3600:.6f})" departLane="{lane}" '
        f'departSpeed="{speed}"><route edges="{edges_}"/></flow>'
        for name, per_h, lane, speed, edges_ in [
            ("main", main_per_h, "best", "desired", "before merge after"),
            ("ramp", ramp_per_h, "0", "20", "ramp merge after"),
        ]
    )
    routes = folder / f"motorway-{model}.rou.xml"
    routes.write_text(f"<routes>{vehicle_type(model)}{flows}</routes>")
    lanes = frozenset({"before_0", "before_1", "merge_1", "merge_2", "after_0", "after_1"})
    meet = Merge({"before_0": -1000.0, "merge_1": 0.0}, {"ramp_0": -ramp_m, "merge_0": 0.0})
    right = {"before_0": 0.0, "merge_1": 1000.0, "after_0": 1250.0}
    return Road("motorway", network, routes, end_s, 3000.0, lanes, min(120.0, end_s / 2), right, meet)
