"""How far things are, on a terminal."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import Any

from tqdm import tqdm


class Bar:
    """A bar for each task, where it is wanted and stderr is a terminal; nothing elsewhere."""

    def __init__(self, wanted: bool) -> None:
        self._wanted = wanted and sys.stderr.isatty()
        self._bar: tqdm[Any] | None = None

    def __enter__(self) -> Bar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()

    def told(self, share: float, regime: str) -> None:
        """A task is so far, 0 to 1."""
        if not self._wanted:
            return
        if self._bar is None or self._bar.desc != f"{regime}: " or share < self._bar.n / 100:
            if self._bar is not None:
                self._bar.close()
            self._bar = tqdm(
                desc=regime, total=100, unit="%", bar_format="{desc}: {percentage:3.0f}%|{bar:40}| {elapsed}"
            )
        self._bar.n = round(100 * share)
        self._bar.refresh()
