"""A client whose answers are awaited: `Client`, awaited."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator, Mapping
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
from .transport import Async, Wire
from .windows import Predictions, Windows


class AsyncClient:
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
        self._transport = Async(Wire(url, key or os.environ.get("HEADWAY_KEY"), patience or Patience(), timeout_s))

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Closes its connections."""
        await self._transport.http.aclose()

    def model(self, name: str = "default") -> AsyncModel:
        """A model by its name. Nothing is asked yet."""
        return AsyncModel(self._transport, name)

    async def models(self) -> list[ModelInfo]:
        """Every model that the key may know of."""
        return await self._transport.run(operations.models())

    async def create_model(
        self,
        name: str,
        *,
        method: str = "ewc",
        settings: Mapping[str, Any] | None = None,
        from_: tuple[str, int] | None = None,
    ) -> AsyncModel:
        """A new model; `from_` a version of another one, it goes on from there."""
        await self._transport.run(operations.create_model(name, method, settings or {}, from_))
        return self.model(name)


class AsyncModel:
    """A model of a server."""

    def __init__(self, transport: Async, name: str) -> None:
        self._transport = transport
        self.name = name

    async def _run(self, operation: Operation[T]) -> T:
        return await self._transport.run(operation)

    async def info(self) -> ModelInfo:
        """What serves, what is learned on from, and every setting."""
        return await self._run(operations.info(self.name))

    async def upload(
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
            return await self._run(operations.upload(self.name, events, given, bars.of_bytes))

    async def train(
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
            return (await self._run(operations.train(self.name, batches, regime, settings or {}, bars.of_task)))[-1]

    async def predict(self, windows: Windows, *, version: int | None = None) -> Predictions:
        """The next acceleration of each window, by what serves or by this version."""
        return await self._run(operations.predict(self.name, windows, version))

    async def simulate(
        self,
        initial: Mapping[str, Any] | np.ndarray[Any, Any],
        leader_speed_mps: Any,
        *,
        version: int | None = None,
    ) -> Simulation:
        """Drives a follower on from a window (`[horizon, 4]`, or as the interface writes it) behind a leader."""
        return await self._run(operations.simulate(self.name, initial, leader_speed_mps, version))

    async def evaluate(
        self,
        events: Events,
        *,
        versions: list[int] | None = None,
        references: list[str] | None = None,
        **options: Any,
    ) -> pd.DataFrame:
        """How versions and `idm`, `gipps` or `constant` do on events that are not kept; `options` as of an upload."""
        return await self._run(operations.evaluate(self.name, events, versions, references or [], options))

    async def events(self, batch_id: str) -> pd.DataFrame:
        """What a batch holds, a row for each step."""
        return await self._run(operations.events(self.name, batch_id))

    def batches(self, *, page_size: int = 1000) -> AsyncIterator[dict[str, Any]]:
        """Every batch, in order of arrival, as the interface writes them."""
        return self._transport.entries(operations.listing(self.name, "/batches", "batches", page_size))

    def rejections(self, batch_id: str, *, page_size: int = 1000) -> AsyncIterator[dict[str, Any]]:
        """Every event of an upload that was refused, and why; its `Batch` has the first thousand."""
        return self._transport.entries(operations.rejections(self.name, batch_id, page_size))

    def tasks(self, *, page_size: int = 1000) -> AsyncIterator[dict[str, Any]]:
        """Every task, as the interface writes them."""
        return self._transport.entries(operations.listing(self.name, "/tasks", "tasks", page_size))

    def history(self, *, page_size: int = 1000) -> AsyncIterator[dict[str, Any]]:
        """Who served when and why, the oldest first."""
        return self._transport.entries(operations.listing(self.name, "/history", "history", page_size))

    async def versions(self) -> list[Version]:
        """Every version, the oldest first."""
        return await self._run(operations.versions(self.name))

    async def evaluation(self, version: int) -> pd.DataFrame:
        """How a version drives on the test events of every regime that it has learned."""
        return await self._run(operations.evaluation(self.name, version))

    async def forgetting(self) -> pd.DataFrame:
        """Regimes × versions: spacing error over what it was when just learned. Above 1, something was forgotten."""
        return await self._run(operations.forgetting(self.name))

    async def promote(self, version: int, *, reason: str, force: bool = False) -> dict[str, Any]:
        """Lets a version serve; what is learned next still goes on from where learning was."""
        return await self._run(operations.move(self.name, "/promote", version, reason, force))

    async def rollback(self, version: int | None = None, *, reason: str, force: bool = False) -> dict[str, Any]:
        """Serving and learning go back to a version, the parent of what serves where none is named."""
        return await self._run(operations.move(self.name, "/rollback", version, reason, force))

    async def export(self, version: int, to: str | Path, *, format: str) -> Path:
        """Writes a version into a file: `safetensors`, `onnx`, or `sumo`."""
        return await self._run(operations.artifact(self.name, version, format, Path(to)))
