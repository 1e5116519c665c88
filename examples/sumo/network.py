"""Roads and traffic: a ring, and a motorway with an on-ramp, as SUMO's files."""

from __future__ import annotations

import math
import subprocess
from dataclasses import dataclass
from pathlib import Path

import sumo

STEP_S = 0.1
VEHICLE_LENGTH_M = 5.0
MIN_GAP_M = 2.0

TYPES = {
    "idm": 'carFollowModel="IDM" accel="1.2" decel="2.0" tau="1.0" delta="4"',
    "krauss": 'carFollowModel="Krauss" accel="2.6" decel="4.5" tau="1.0" sigma="0.5"',
}


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


def vehicle_type(model: str, max_speed_mps: float) -> str:
    """The one type of all vehicles. What drives by a server is SUMO's IDM where nobody else drives."""
    kind = TYPES.get(model, TYPES["idm"])
    return (
        f'<vType id="car" {kind} length="{VEHICLE_LENGTH_M}" minGap="{MIN_GAP_M}" maxSpeed="{max_speed_mps}" '
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
    subprocess.run([*command, "-o", network, *options], check=True, capture_output=True)
    return network


def ring(
    folder: Path,
    model: str,
    *,
    vehicles: int = 22,
    length_m: float = 260.0,
    end_s: float = 600.0,
    speed_mps: float = 15.0,
) -> Road:
    """A single lane that closes on itself (Sugiyama et al. 2008), all vehicles at rest and evenly spread at first."""
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
            f'<edge id="e{k}" from="n{k}" to="n{(k + 1) % arcs}" numLanes="1" speed="{speed_mps}" shape="{shape}" '
            f'length="{length_m / arcs}"/>'
        )
    network = _built(folder, f"ring-{model}", nodes, edges, "--no-internal-links", "true", "--no-turnarounds", "true")
    laps = math.ceil(end_s * speed_mps / length_m) + 1
    departures = ""
    for number in range(vehicles):
        position_m = number * length_m / vehicles
        first = int(position_m // (length_m / arcs))
        route = " ".join(f"e{(first + k) % arcs}" for k in range(arcs))
        departures += (
            f'<vehicle id="v{number}" type="car" depart="0" departSpeed="0" '
            f'departPos="{position_m % (length_m / arcs):.3f}">'
            f'<route edges="{route}" repeat="{laps}"/></vehicle>'
        )
    routes = folder / f"ring-{model}.rou.xml"
    routes.write_text(f"<routes>{vehicle_type(model, speed_mps)}{departures}</routes>")
    return Road("ring", network, routes, end_s, length_m, frozenset(f"e{k}_0" for k in range(arcs)))


def platoon(folder: Path, model: str, *, vehicles: int = 22, end_s: float = 300.0, speed_mps: float = 15.0) -> Road:
    """A lane of 6 km, on which vehicles follow one that drives by a script: what a model can learn to follow from."""
    nodes = '<node id="a" x="0" y="0"/><node id="b" x="6000" y="0"/>'
    edges = f'<edge id="lane" from="a" to="b" numLanes="1" speed="{speed_mps}"/>'
    network = _built(folder, f"platoon-{model}", nodes, edges)
    departures = "".join(
        f'<vehicle id="v{number}" type="car" depart="0" departPos="{600 - 12 * number}" departSpeed="0">'
        '<route edges="lane"/></vehicle>'
        for number in range(vehicles)
    )
    routes = folder / f"platoon-{model}.rou.xml"
    routes.write_text(f"<routes>{vehicle_type(model, speed_mps)}{departures}</routes>")
    return Road("platoon", network, routes, end_s, 6000.0, frozenset({"lane_0"}))


def motorway(
    folder: Path, model: str, *, end_s: float = 300.0, main_per_h: float = 3200.0, ramp_per_h: float = 600.0
) -> Road:
    """Two lanes of 3 km with an on-ramp after the first, and an acceleration lane of 250 m, in which SUMO drives."""
    speed_mps = 30.0
    xs = {"a": 0, "b": 1000, "c": 1250, "d": 3000}
    nodes = "".join(f'<node id="{name}" x="{x}" y="0"/>' for name, x in xs.items())
    nodes += '<node id="r0" x="600" y="-60"/>'
    edges = "".join(
        f'<edge id="{name}" from="{begin}" to="{end}" numLanes="{lanes}" speed="{speed}"/>'
        for name, begin, end, lanes, speed in [
            ("before", "a", "b", 2, speed_mps),
            ("merge", "b", "c", 3, speed_mps),
            ("after", "c", "d", 2, speed_mps),
            ("ramp", "r0", "b", 1, 22.0),
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
        f'<flow id="{name}" type="car" begin="0" end="{end_s}" vehsPerHour="{per_h}" departLane="{lane}" '
        f'departSpeed="{speed}"><route edges="{edges_}"/></flow>'
        for name, per_h, lane, speed, edges_ in [
            ("main", main_per_h, "best", "desired", "before merge after"),
            ("ramp", ramp_per_h, "0", "20", "ramp merge after"),
        ]
    )
    routes = folder / f"motorway-{model}.rou.xml"
    routes.write_text(f"<routes>{vehicle_type(model, speed_mps)}{flows}</routes>")
    # Not on the ramp, nor on the two lanes where it joins.
    lanes = frozenset({"before_0", "before_1", "merge_2", "after_0", "after_1"})
    return Road("motorway", network, routes, end_s, 3000.0, lanes)
