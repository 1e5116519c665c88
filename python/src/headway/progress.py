"""How far things are: told to whoever asks, or shown on a terminal."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, TypeAlias

from tqdm import tqdm


@dataclass(frozen=True)
class Progress:
    """How far a task is."""

    task_id: str
    regime: str
    state: str
    """`queued`, `running`, `succeeded`, `failed` or `cancelled`."""
    share: float
    """From 0 to 1."""
    raw: dict[str, Any]
    """What the server said last: a `Task`, or a `Progress` with `epoch`, `loss`, `penalty`, `seconds_left`."""


Follow: TypeAlias = bool | Callable[[Progress], None]
"""Whether a bar is shown where stderr is a terminal, or who is told instead."""


class Listener:
    """Makes `Progress` of the lines of a task's event stream."""

    def __init__(self, tell: Callable[[Progress], None], task: dict[str, Any]) -> None:
        self._tell = tell
        self._event = ""
        self._task = task
        self._told(task)

    def line(self, line: str) -> None:
        """One line. A comment, which keeps the connection open, says nothing."""
        name, _, value = line.partition(":")
        value = value.removeprefix(" ")
        if name == "event":
            self._event = value
        elif name == "data" and self._event == "task":
            self.task(json.loads(value))
        elif name == "data" and self._event == "progress":
            self._told(json.loads(value))

    def task(self, task: dict[str, Any]) -> None:
        """The task itself, from the stream or from elsewhere."""
        self._task = task
        self._told(task)

    def _told(self, said: dict[str, Any]) -> None:
        task = self._task
        share = 1.0 if task["state"] == "succeeded" else float(said["progress"] or 0.0)
        self._tell(Progress(task["task_id"], task["regime"], task["state"], share, said))


class Bars:
    """A bar for each task or file, where stderr is a terminal; or somebody who is told; or nothing."""

    def __init__(self, follow: Follow) -> None:
        self._shown = follow is True and sys.stderr.isatty()
        self._told = follow if callable(follow) else None
        self._bar: tqdm[Any] | None = None
        self._of = ""

    def __enter__(self) -> Bars:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()

    @property
    def of_task(self) -> Callable[[Progress], None] | None:
        """Whom a task's progress is told, or none."""
        return self._told or (self._task if self._shown else None)

    @property
    def of_bytes(self) -> Callable[[int, int], None] | None:
        """Whom it is told how many bytes of how many are sent, or none."""
        return self._bytes if self._shown else None

    def _task(self, progress: Progress) -> None:
        form = "{desc}: {percentage:3.0f}%|{bar:40}| {elapsed}{postfix}"
        bar = self._show(progress.task_id, desc=progress.regime, total=100, bar_format=form)
        if "seconds_left" in progress.raw and progress.raw["seconds_left"] is not None:
            bar.set_postfix_str(f"{progress.raw['seconds_left']:.0f} s left", refresh=False)
        elif progress.state != "running":
            bar.set_postfix_str(progress.state, refresh=False)
        self._at(bar, round(100 * progress.share))

    def _bytes(self, sent: int, total: int) -> None:
        # What is sent within half a second needs no bar.
        self._at(self._show("upload", desc="upload", total=total, unit="B", unit_scale=True, delay=0.5), sent)

    def _show(self, of: str, **options: Any) -> tqdm[Any]:
        if self._bar is None or self._of != of:
            if self._bar is not None:
                self._bar.close()
            self._bar, self._of = tqdm(miniters=1, **options), of
        return self._bar

    @staticmethod
    def _at(bar: tqdm[Any], n: int) -> None:
        # Forwards by what was added, so that tqdm heeds its delay; a second try begins anew.
        if n < bar.n:
            bar.reset()
        bar.update(n - bar.n)
