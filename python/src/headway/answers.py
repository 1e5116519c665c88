"""What a server tells of batches, tasks, versions and models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd


@dataclass(frozen=True)
class Batch:
    """An upload: what was taken, and what was not and why."""

    batch_id: str
    accepted: int
    duplicates: int
    rejected_count: int
    rejected: list[dict[str, Any]]
    """The first thousand events that were refused: where, `code`, `detail`."""
    task_ids: list[str]
    """Tasks that became due by it."""
    raw: dict[str, Any]
    """Everything the server said."""

    @classmethod
    def read(cls, said: dict[str, Any]) -> Batch:
        """Of an answer."""
        return cls(
            said["batch_id"],
            said["accepted"],
            said["duplicates"],
            said["rejected_count"],
            said["rejected"],
            said["task_ids"],
            said,
        )


@dataclass(frozen=True)
class Version:
    """What a task made."""

    version: int
    regime: str
    stage: int
    method: str
    weights_sha256: str
    note: str | None
    promoted: bool | None
    """Whether it was promoted when it was made; none where nothing decided."""
    raw: dict[str, Any]

    @classmethod
    def read(cls, said: dict[str, Any]) -> Version:
        """Of an answer."""
        decision = (said.get("promotion") or {}).get("decision")
        return cls(
            said["version"],
            said["regime"],
            said["stage"],
            said["method"],
            said["weights_sha256"],
            said["note"],
            None if decision is None else decision == "promoted",
            said,
        )


@dataclass(frozen=True)
class ModelInfo:
    """A model: what serves, and what is learned on from."""

    model: str
    method: str
    live: int | None
    head: int | None
    settings: dict[str, Any]
    raw: dict[str, Any]

    @classmethod
    def read(cls, said: dict[str, Any]) -> ModelInfo:
        """Of an answer."""
        return cls(said["model"], said["method"], said["live"], said["head"], said["settings"], said)


@dataclass(frozen=True)
class Simulation:
    """A follower that was driven behind a given leader, one value a step."""

    spacing_m: npt.NDArray[np.float64]
    follower_speed_mps: npt.NDArray[np.float64]
    accel_mps2: npt.NDArray[np.float64]
    collided: bool
    version: int
    flags: frozenset[str]

    @classmethod
    def read(cls, said: dict[str, Any]) -> Simulation:
        """Of an answer."""
        return cls(
            np.asarray(said["spacing_m"]),
            np.asarray(said["follower_speed_mps"]),
            np.asarray(said["accel_mps2"]),
            said["collided"],
            said["version"],
            frozenset(said["flags"]),
        )


MEASURES = ["spacing_mse", "speed_mse", "collision_rate_percent", "forgetting_ratio"]


def measures_of(named: str, drivers: Mapping[Any, list[dict[str, Any]]]) -> pd.DataFrame:
    """How drivers do, a row for each of them and each regime; what was not measured is NaN."""
    columns = ["regime", "events", "steps", *MEASURES]
    rows = [
        {named: driver, **{column: task.get(column) for column in columns}}
        for driver, tasks in drivers.items()
        for task in tasks
    ]
    return pd.DataFrame(rows, columns=[named, *columns]).astype(dict.fromkeys(MEASURES, float))
