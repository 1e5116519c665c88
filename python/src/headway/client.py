"""A client that waits for its answers."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pandas as pd

from . import operations
from .answers import Batch, ModelInfo, Simulation, Version
from .calls import Operation, T
from .events import Events
from .patience import Patience
from .progress import Bars, Follow
from .transport import Sync, Wire
from .windows import Predictions, Windows


class Client:
    """A server, and the key that it is shown. May be used as a context, which closes its connections."""

    def __init__(
        self,
        url: str = "http://127.0.0.1:8080",
        *,
        key: str | None = None,
        patience: Patience | None = None,
        timeout_s: float = 60.0,
    ) -> None:
        """`key` is that of the variable HEADWAY_KEY where none is given."""
        self._transport = Sync(Wire(url, key or os.environ.get("HEADWAY_KEY"), patience or Patience(), timeout_s))

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes its connections."""
        self._transport.http.close()

    def model(self, name: str = "default") -> Model:
        """A model by its name. Nothing is asked yet."""
        return Model(self._transport, name)

    def models(self) -> list[ModelInfo]:
        """Every model that the key may know of."""
        return self._transport.run(operations.models())

    def create_model(
        self,
        name: str,
        *,
        method: str = "ewc",
        settings: Mapping[str, Any] | None = None,
        from_: tuple[str, int] | None = None,
    ) -> Model:
        """A new model; `from_` a version of another one, it goes on from there."""
        self._transport.run(operations.create_model(name, method, settings or {}, from_))
        return self.model(name)


class Model:
    """A model of a server."""

    def __init__(self, transport: Sync, name: str) -> None:
        self._transport = transport
        self.name = name

    def _run(self, operation: Operation[T]) -> T:
        return self._transport.run(operation)

    def info(self) -> ModelInfo:
        """What serves, what is learned on from, and every setting."""
        return self._run(operations.info(self.name))

    def upload(
        self,
        events: Events,
        *,
        regime: str | None = None,
        source: str | None = None,
        preset: str | None = None,
        dt_s: float | None = None,
        progress: bool = True,
        **options: Any,
    ) -> Batch:
        """Uploads events. `options` are the others that the interface knows, such as `spacing` or `min_duration_s`."""
        given = {"regime": regime, "source": source, "preset": preset, "dt_s": dt_s, **options}
        with Bars(progress) as bars:
            return self._run(operations.upload(self.name, events, given, bars.of_bytes))

    def train(
        self,
        *,
        batches: list[str] | None = None,
        regime: str | None = None,
        settings: Mapping[str, Any] | None = None,
        progress: Follow = True,
    ) -> Version:
        """Learns what is pending, or these batches, and gives the last version that came of it.

        `progress` is whether a bar is shown on a terminal, or a function that is told of each `Progress`.
        """
        with Bars(progress) as bars:
            return self._run(operations.train(self.name, batches, regime, settings or {}, bars.of_task))[-1]

    def predict(self, windows: Windows, *, version: int | None = None) -> Predictions:
        """The next acceleration of each window, by what serves or by this version."""
        return self._run(operations.predict(self.name, windows, version))

    def simulate(
        self,
        initial: Mapping[str, Any] | np.ndarray[Any, Any],
        leader_speed_mps: Any,
        *,
        version: int | None = None,
    ) -> Simulation:
        """Drives a follower on from a window (`[horizon, 4]`, or as the interface writes it) behind a leader."""
        return self._run(operations.simulate(self.name, initial, leader_speed_mps, version))

    def evaluate(
        self,
        events: Events,
        *,
        versions: list[int] | None = None,
        references: list[str] | None = None,
        **options: Any,
    ) -> pd.DataFrame:
        """How versions and `idm`, `gipps` or `constant` do on events that are not kept; `options` as of an upload."""
        return self._run(operations.evaluate(self.name, events, versions, references or [], options))

    def events(self, batch_id: str) -> pd.DataFrame:
        """What a batch holds, a row for each step."""
        return self._run(operations.events(self.name, batch_id))

    def batches(self, *, page_size: int = 1000) -> Iterator[dict[str, Any]]:
        """Every batch, in order of arrival, as the interface writes them."""
        return self._transport.entries(operations.listing(self.name, "/batches", "batches", page_size))

    def rejections(self, batch_id: str, *, page_size: int = 1000) -> Iterator[dict[str, Any]]:
        """Every event of an upload that was refused, and why; its `Batch` has the first thousand."""
        return self._transport.entries(operations.rejections(self.name, batch_id, page_size))

    def tasks(self, *, page_size: int = 1000) -> Iterator[dict[str, Any]]:
        """Every task, as the interface writes them."""
        return self._transport.entries(operations.listing(self.name, "/tasks", "tasks", page_size))

    def history(self, *, page_size: int = 1000) -> Iterator[dict[str, Any]]:
        """Who served when and why, the oldest first."""
        return self._transport.entries(operations.listing(self.name, "/history", "history", page_size))

    def versions(self) -> list[Version]:
        """Every version, the oldest first."""
        return self._run(operations.versions(self.name))

    def evaluation(self, version: int) -> pd.DataFrame:
        """How a version drives on the test events of every regime that it has learned."""
        return self._run(operations.evaluation(self.name, version))

    def forgetting(self) -> pd.DataFrame:
        """Regimes × versions: spacing error over what it was when just learned. Above 1, something was forgotten."""
        return self._run(operations.forgetting(self.name))

    def promote(self, version: int, *, reason: str, force: bool = False) -> dict[str, Any]:
        """Lets a version serve; what is learned next still goes on from where learning was."""
        return self._run(operations.move(self.name, "/promote", version, reason, force))

    def rollback(self, version: int | None = None, *, reason: str, force: bool = False) -> dict[str, Any]:
        """Serving and learning go back to a version, the parent of what serves where none is named."""
        return self._run(operations.move(self.name, "/rollback", version, reason, force))

    def export(self, version: int, to: str | Path, *, format: str) -> Path:
        """Writes a version into a file: `safetensors`, `onnx`, or `sumo`."""
        return self._run(operations.artifact(self.name, version, format, Path(to)))
