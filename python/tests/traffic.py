"""Made-up events."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

STEPS = 40


def frame(name: str, speed_mps: float, count: int = 12) -> pd.DataFrame:
    """Followers that lag behind leaders on waves: a row for each step, every fourth event for tests."""
    t = np.arange(STEPS) * 0.1
    frames = []
    for number in range(count):
        leader = speed_mps + np.sin(1.5 * t + number)
        follower = speed_mps + np.sin(1.5 * t + number - 0.6)
        between = (leader[1:] + leader[:-1] - follower[1:] - follower[:-1]) / 2
        spacing = 12 + speed_mps + np.concatenate([[0], np.cumsum(0.1 * between)])
        split = "test" if number % 4 == 3 else "train"
        columns: dict[str, Any] = {"event_id": f"{name}-{number}", "split": split, "t": t, "spacing_m": spacing}
        frames.append(pd.DataFrame({**columns, "follower_speed_mps": follower, "leader_speed_mps": leader}))
    return pd.concat(frames, ignore_index=True)


def events(name: str, speed_mps: float, count: int = 12) -> list[dict[str, Any]]:
    """The same, as the interface writes them."""
    columns = ["spacing_m", "follower_speed_mps", "leader_speed_mps"]
    return [
        {"event_id": event_id, "dt_s": 0.1, "split": rows["split"].iloc[0], **{c: rows[c].tolist() for c in columns}}
        for event_id, rows in frame(name, speed_mps, count).groupby("event_id", sort=False)
    ]


def windows(count: int, horizon: int = 5) -> npt.NDArray[np.float64]:
    """Windows `[count, horizon, 4]`, seeded."""
    random = np.random.default_rng(7)
    made = random.uniform(8, 12, (count, horizon, 4))
    made[..., 2] = made[..., 1] - made[..., 0]
    return made
