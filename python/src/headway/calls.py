"""What is asked of a server, and what it answered, without saying how either is sent."""

from __future__ import annotations

import json
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")


def json_of(value: Any) -> bytes:
    """A value as JSON; arrays and numbers of NumPy are what they hold."""
    return json.dumps(value, allow_nan=False, default=_plain).encode()


def _plain(value: Any) -> Any:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


@dataclass(frozen=True)
class Call:
    """One request. A body that is a path is read while it is sent."""

    method: str
    path: str
    query: Mapping[str, Any] = field(default_factory=dict)
    body: bytes | Path | None = None
    headers: Mapping[str, str] = field(default_factory=dict)
    repeatable: bool = True
    """Whether sending it twice does no more than sending it once."""
    wait_s: float = 0.0
    """How long the server was asked to wait before it answers."""
    sent: Callable[[int, int], None] | None = None
    """Is told how many bytes of the body's are on their way."""
    heard: Callable[[str], None] | None = None
    """Is told every line of the answer as it comes.

    Such a call is sent once, and has ended when it breaks off or is refused: what it was about is asked afterwards.
    """


@dataclass(frozen=True)
class Answer:
    """What a server answered that did as it was asked."""

    status: int
    headers: Mapping[str, str]
    body: bytes

    def json(self) -> Any:
        """The body, which is JSON."""
        return json.loads(self.body)


Operation = Generator[Call, Answer, T]
"""Calls one after another, each knowing the answers to those before; what it returns is what came of them.

An operation is written once, and driven by a client that waits or by one that awaits.
"""
