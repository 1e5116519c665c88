#!/usr/bin/env python3
"""Recordings of whole roads, and the car-following events in them by the published definitions.

    tests/golden/scenes.py make      writes tests/golden/scenes/ngsim.csv.gz, fcd.xml.gz and fcd.csv.gz
    tests/golden/scenes.py           extracts tests/golden/scenes/events.json.gz from them
    tests/golden/scenes.py ngsim|fcd FILE...
                                     extracts from other files, and prints counts and digests

The NGSIM scene is made up, in the form of the published files; the FCD is what SUMO writes (pip install eclipse-sumo numpy
pandas). Extraction shares nothing with Headway's: it follows the data's own definitions, a table at a time.
"""

import gzip
import hashlib
import json
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pandas as pd

FOLDER = Path(__file__).resolve().parent / "scenes"
# FollowNet: the same leader for 15 s or more; spacing bounded.
MIN_S, MAX_S, MIN_M, MAX_M = 15.0, 60.0, 0.5, 120.0
FOOT_M = 0.3048


def segments(rows: pd.DataFrame) -> tuple[list[dict], dict]:
    """Events of rows with follower, time_ms, before (the row of the follower right before it, or not), speed, leader,
    leader_speed, spacing, and why a row can be in none; sorted by follower and time."""
    same = rows.follower.eq(rows.follower.shift()) & rows.before
    leads = rows.why.eq("")
    goes_on = same & leads & leads.shift(fill_value=False) & rows.leader.eq(rows.leader.shift())
    dropped = rows.why[~leads].value_counts().to_dict()
    events, short = [], 0
    for _, piece in rows[leads].groupby((~goes_on)[leads].cumsum(), sort=False):
        step = int(piece.time_ms.diff().median()) if len(piece) > 1 else 0
        most = int(MAX_S * 1000) // step if step else 1
        for start in range(0, len(piece), most):
            part = piece.iloc[start:start + most]
            if len(part) < 2 or len(part) * step < MIN_S * 1000:
                short += len(part)
                continue
            first = part.iloc[0]
            events.append({
                "event_id": f"{first.road}{first.follower}>{first.leader}@{first['at']}",
                "run": str(first.follower),
                "source": first.source or None,
                "dt_s": step / 1000,
                "spacing_m": part.spacing.tolist(),
                "follower_speed_mps": part.speed.tolist(),
                "leader_speed_mps": part.leader_speed.tolist(),
            })
    if short:
        dropped["too_short"] = short
    return events, dropped


def bounded(rows: pd.DataFrame) -> pd.Series:
    """Why a row can be in no event; nothing where it can."""
    why = np.where(rows.spacing < MIN_M, "too_close", np.where(rows.spacing > MAX_M, "too_far", ""))
    why = np.where(rows.leader_speed.isna() | rows.spacing.isna(), "leader_missing", why)
    return pd.Series(np.where(rows.leader.isna(), "no_leader", why), index=rows.index)


def ngsim(path: str) -> dict:
    """NGSIM: Space_Headway is from front to front, in feet; Preceding 0 is nobody; ten frames a second."""
    table = pd.read_csv(path)
    table.columns = [name.lower() for name in table.columns]
    table = table.drop_duplicates()
    if "location" not in table:
        table["location"] = ""
    clock = "global_time" in table
    table["time_ms"] = table.global_time if clock else table.frame_id * 100
    key = ["location", "vehicle_id", "time_ms"]
    assert not table.duplicated(key).any()
    leads = table[[*key, "v_length", "v_vel"]].rename(columns={"vehicle_id": "preceding", "v_length": "long", "v_vel": "fast"})
    table = table.merge(leads, how="left", on=["location", "preceding", "time_ms"]).sort_values(key, ignore_index=True)
    # A leader that is itself follows nobody.
    table.loc[table.preceding == table.vehicle_id, ["long", "fast"]] = np.nan
    rows = pd.DataFrame({
        "road": np.where(table.location == "", "", table.location + "/"),
        "source": table.location,
        "follower": table.vehicle_id,
        "vehicle": table.location + "/" + table.vehicle_id.astype(str),
        "time_ms": table.time_ms,
        "at": table.time_ms if clock else table.frame_id,
        "before": table.frame_id.diff().eq(1) & table.time_ms.diff().eq(100) & table.location.eq(table.location.shift()),
        "speed": table.v_vel * FOOT_M,
        "leader": table.preceding.where(table.preceding != 0).astype("Int64"),
        "leader_speed": table.fast * FOOT_M,
        "spacing": (table.space_headway - table.long) * FOOT_M,
    })
    rows["why"] = bounded(rows)
    events, dropped = segments(rows)
    pairs = rows[rows.leader.notna()].groupby("vehicle").leader.nunique().sum()
    return {"rows": len(rows), "vehicles": rows.vehicle.nunique(), "pairs": int(pairs), "dropped_steps": dropped, "events": events}


def fcd(path: str) -> dict:
    """SUMO: leaderGap is from bumper to bumper; -1, or no leaderID, is nobody."""
    opened = gzip.open(path) if str(path).endswith(".gz") else open(path, "rb")
    table, times = [], 0
    for _, element in ElementTree.iterparse(opened):
        if element.tag != "timestep":
            continue
        times += 1
        for vehicle in element.iterfind("vehicle"):
            said = vehicle.attrib
            alone = not said.get("leaderID") or float(said["leaderGap"]) == -1
            table.append((said["id"], float(element.get("time")), times, float(said["speed"]),
                          None if alone else said["leaderID"], np.nan if alone else float(said["leaderSpeed"]),
                          np.nan if alone else float(said["leaderGap"])))
        element.clear()
    rows = pd.DataFrame(table, columns=["follower", "time", "nth", "speed", "leader", "leader_speed", "spacing"])
    rows = rows.sort_values(["follower", "nth"], ignore_index=True)
    rows["time_ms"] = (rows.time * 1000).round().astype(int)
    rows["at"] = [str(ms / 1000).removesuffix(".0") for ms in rows.time_ms]
    rows["before"] = rows.nth.diff().eq(1)
    rows["road"] = rows["source"] = ""
    rows["why"] = bounded(rows)
    events, dropped = segments(rows)
    pairs = rows[rows.leader.notna()].groupby("follower").leader.nunique().sum()
    return {"rows": len(rows), "vehicles": rows.follower.nunique(), "pairs": int(pairs), "dropped_steps": dropped, "events": events}


def made_up_lane(rng, lengths, frames: int, spread: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions of front bumpers and speeds, feet, of vehicles one behind the other; the first as it likes."""
    position = np.zeros((frames, len(lengths)))
    speed = np.zeros_like(position)
    position[0] = -np.cumsum([0.0, *(lengths[:-1] + spread)])
    speed[0] = 30.0
    wish = 30.0 + 8.0 * np.sin(np.arange(frames) * 0.1 / 5.0)
    for t in range(1, frames):
        gap = np.concatenate([[np.inf], position[t - 1, :-1] - lengths[:-1] - position[t - 1, 1:]])
        ahead = np.concatenate([[wish[t]], speed[t - 1, :-1]])
        accel = np.where(np.isinf(gap), 1.0 * (ahead - speed[t - 1]),
                         0.25 * (gap - 12.0 - 1.2 * speed[t - 1]) + 0.8 * (ahead - speed[t - 1]))
        speed[t] = np.clip(speed[t - 1] + 0.1 * np.clip(accel + 0.3 * rng.normal(size=len(lengths)), -8.0, 6.0), 0.0, 60.0)
        position[t] = position[t - 1] + 0.05 * (speed[t - 1] + speed[t])
    return position, speed


def make_ngsim() -> str:
    rng = np.random.default_rng(7)
    table = []

    def lane(location, clock, vehicles, frames, first_frame, spread, number):
        lengths = rng.uniform(13.0, 18.0, size=len(vehicles)).round(1)
        lengths[-1] = 48.5
        position, speed = made_up_lane(rng, lengths, frames, spread)
        for i, vehicle in enumerate(vehicles):
            for t in range(frames):
                leader = vehicles[i - 1] if i else 0
                headway = position[t, i - 1] - position[t, i] if i else 0.0
                table.append([vehicle, first_frame + t, frames, clock + 100 * (first_frame + t), 20.0 + 12 * number,
                              position[t, i] + 900, 6451000.0, 1873000.0, lengths[i], 6.5, 2, speed[t, i], 0.0, number, leader,
                              0, headway, 0.0, location])

    lane("us-101", 1_118_846_979_700, [2, 5, 11, 17], 260, 13, 60.0, 1)
    lane("us-101", 1_118_846_979_700, [3, 8, 21], 190, 40, 330.0, 2)
    # A later period, and another place, that count anew.
    lane("us-101", 1_118_847_879_700, [2, 5], 170, 20, 50.0, 1)
    lane("i-80", 1_113_433_135_300, [5, 2], 160, 13, 50.0, 3)
    names = ("Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,Global_X,Global_Y,v_Length,v_Width,v_Class,v_Vel,v_Acc,"
             "Lane_ID,Preceding,Following,Space_Headway,Time_Headway,Location").split(",")
    rows = pd.DataFrame(table, columns=names).round(3)
    early = (rows.Location == "us-101") & (rows.Global_Time < 1_118_847_500_000)
    # 11 leaves its lane after 180 frames: then 17 is behind 5, farther, and 11 behind somebody who is not in the file.
    late = rows.Frame_ID >= 193
    front = rows[early & (rows.Vehicle_ID == 5)].set_index("Frame_ID").Local_Y
    last = early & late & (rows.Vehicle_ID == 17)
    rows.loc[last, "Preceding"] = 5
    rows.loc[last, "Space_Headway"] = (rows.Frame_ID[last].map(front) - rows.Local_Y[last]).round(3)
    rows.loc[early & late & (rows.Vehicle_ID == 11), ["Preceding", "Lane_ID"]] = [99, 2]
    # 5 was not seen for three frames, and 21 is said twice in one.
    rows = rows[~(early & (rows.Vehicle_ID == 5) & rows.Frame_ID.between(200, 202))]
    again = rows[(rows.Vehicle_ID == 21) & (rows.Frame_ID == 50)]
    rows = pd.concat([rows, again]).sort_values(["Location", "Vehicle_ID", "Global_Time"], kind="stable")
    return rows.to_csv(index=False)


def make_fcd(folder: Path) -> tuple[str, str]:
    import sumo

    tool = Path(sumo.SUMO_HOME)
    (folder / "nodes.nod.xml").write_text('<nodes><node id="a" x="0" y="0"/><node id="b" x="600" y="0"/><node id="c" x="1000" y="0"/></nodes>')
    (folder / "edges.edg.xml").write_text('<edges><edge id="ab" from="a" to="b" numLanes="2" speed="20"/>'
                                          '<edge id="bc" from="b" to="c" numLanes="1" speed="12"/></edges>')
    (folder / "routes.rou.xml").write_text(
        '<routes><vType id="car" sigma="0.5" length="4.5"/><vType id="truck" length="12" maxSpeed="10"/>'
        '<route id="r" edges="ab bc"/><flow id="f" type="car" route="r" begin="0" number="7" period="2.5" departLane="random"'
        ' departSpeed="10"/><vehicle id="t" type="truck" route="r" depart="4" departLane="0"/></routes>')
    run = lambda *command: subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    run(tool / "bin" / "netconvert", "-n", "nodes.nod.xml", "-e", "edges.edg.xml", "-o", "road.net.xml")
    run(tool / "bin" / "sumo", "-n", "road.net.xml", "-r", "routes.rou.xml", "--step-length", "0.1", "--end", "50", "--seed", "7",
        "--no-step-log", "--fcd-output", "fcd.xml", "--fcd-output.max-leader-distance", "200",
        "--fcd-output.attributes", "id,speed,pos,lane,leaderID,leaderSpeed,leaderGap")
    run(sys.executable, tool / "tools" / "xml" / "xml2csv.py", "fcd.xml", "-o", "fcd.csv")
    text = (folder / "fcd.xml").read_text()
    # Without the comment that holds the time and the paths of the run.
    start, end = text.index("<!--"), text.index("-->") + 4
    return text[:start] + text[end:], (folder / "fcd.csv").read_text()


def keep(name: str, text: str) -> None:
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / name).write_bytes(gzip.compress(text.encode(), mtime=0))


def main(arguments: list[str]) -> None:
    if arguments[:1] == ["make"]:
        keep("ngsim.csv.gz", make_ngsim())
        with tempfile.TemporaryDirectory() as folder:
            xml, csv = make_fcd(Path(folder))
        keep("fcd.xml.gz", xml)
        keep("fcd.csv.gz", csv)
    elif arguments:
        for path in arguments[1:]:
            found = {"ngsim": ngsim, "fcd": fcd}[arguments[0]](path)
            events = found.pop("events")
            ids = hashlib.sha256("\n".join(sorted(event["event_id"] for event in events)).encode()).hexdigest()
            print(path, json.dumps(found), len(events), "events", sum(len(e["spacing_m"]) for e in events), "steps", ids[:16])
    else:
        found = {"ngsim": ngsim(FOLDER / "ngsim.csv.gz"), "fcd": fcd(FOLDER / "fcd.xml.gz")}
        keep("events.json.gz", json.dumps(found))
        for name, scene in found.items():
            print(name, {key: value for key, value in scene.items() if key != "events"})
            print(*(f"{event['event_id']} {len(event['spacing_m'])}" for event in scene["events"]), sep="\n")


main(sys.argv[1:])
