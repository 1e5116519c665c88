"""Windows and accelerations as the bytes of the inference protocol."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from .calls import Answer

Floats = npt.NDArray[np.float32]
Windows: TypeAlias = npt.NDArray[np.floating[Any]] | Sequence[Mapping[str, Any]]
"""An array `[n, horizon, 4]` of follower speed, leader speed, relative speed (m/s) and spacing (m), oldest step first;
or windows as the interface writes them."""

HEADER_LENGTH = "inference-header-content-length"


@dataclass(frozen=True)
class Predictions:
    """One acceleration a window."""

    accel_mps2: Floats
    """What is served, m/s², `[n]`."""
    raw_accel_mps2: Floats
    """The network's own, before the envelope bounds it, m/s², `[n]`."""
    version: int
    """Which version answered."""
    flags: frozenset[str]
    """What the server remarks on some window: `envelope`, `out_of_range`."""

    @property
    def limited(self) -> npt.NDArray[np.bool_]:
        """Where the envelope acted, `[n]`."""
        return np.asarray(self.accel_mps2 != self.raw_accel_mps2)


def array_of(windows: Windows) -> Floats:
    """Windows as an array `[n, horizon, 4]`."""
    if not isinstance(windows, np.ndarray):
        windows = np.stack([_stacked(window) for window in windows])
    array = np.ascontiguousarray(windows, dtype="<f4")
    if array.ndim != 3 or array.shape[2] != 4:
        raise ValueError(f"windows are [n, horizon, 4], not {list(array.shape)}")
    return array


def _stacked(window: Mapping[str, Any]) -> npt.NDArray[np.float64]:
    follower = np.asarray(window["follower_speed_mps"], dtype=np.float64)
    leader = np.asarray(window["leader_speed_mps"], dtype=np.float64)
    return np.stack([follower, leader, leader - follower, np.asarray(window["spacing_m"], dtype=np.float64)], axis=1)


def request_of(windows: Floats) -> tuple[bytes, dict[str, str]]:
    """The body of an inference of these windows, and its headers."""
    tensor = windows.tobytes()
    parameters = {"binary_data_size": len(tensor)}
    inputs = [{"name": "window", "shape": list(windows.shape), "datatype": "FP32", "parameters": parameters}]
    head = json.dumps({"parameters": {"binary_data_output": True}, "inputs": inputs}).encode()
    return head + tensor, {HEADER_LENGTH: str(len(head)), "content-type": "application/octet-stream"}


def predictions_of(answer: Answer) -> Predictions:
    """What an inference answered."""
    at = int(answer.headers[HEADER_LENGTH])
    said = json.loads(answer.body[:at])
    outputs: dict[str, Floats] = {}
    for output in said["outputs"]:
        size = output["parameters"]["binary_data_size"]
        outputs[output["name"]] = np.frombuffer(answer.body[at : at + size], dtype="<f4")
        at += size
    flags = str(said.get("parameters", {}).get("flags", ""))
    return Predictions(
        outputs["accel_mps2"],
        outputs["raw_accel_mps2"],
        int(said["model_version"]),
        frozenset(flag for flag in flags.split(",") if flag),
    )
