"""Operations driven over HTTP: by a client that waits, and by one that awaits."""

from __future__ import annotations

import asyncio
import io
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import httpx

from .calls import Answer, Call, Operation, T
from .operations import Listing
from .patience import Patience, retry_after_s
from .problem import Problem, Unreachable

CHUNK_BYTES = 1 << 18
QUIET_S = 60.0
"""A stream of events of which nothing comes for so long has ended; a server says something every 15 s."""


ENDED = Answer(200, {}, b"")


class Wire:
    """What both ways of sending share: the address, the key, how patient to be."""

    def __init__(self, url: str, key: str | None, patience: Patience, timeout_s: float) -> None:
        if not url.startswith(("http://", "https://")):
            raise ValueError(f"{url!r} is no address of a server: it begins with neither http:// nor https://")
        self.url = url.rstrip("/")
        self.headers = {"authorization": f"Bearer {key}"} if key else {}
        self.patience = patience
        self.timeout_s = timeout_s

    def request(self, call: Call) -> dict[str, Any]:
        """What httpx is told, but for the body."""
        query = {name: value for name, value in call.query.items() if value is not None}
        timeout = httpx.Timeout(self.timeout_s + call.wait_s, connect=min(10.0, self.timeout_s))
        headers = {**self.headers, **call.headers}
        return {
            "method": call.method,
            "url": self.url + call.path,
            "params": query,
            "headers": headers,
            "timeout": timeout,
        }

    def stream(self, call: Call) -> dict[str, Any]:
        """As `request`, of an answer that comes line by line."""
        return {**self.request(call), "timeout": httpx.Timeout(QUIET_S, connect=min(10.0, self.timeout_s))}

    def read(self, call: Call, tries: int, response: httpx.Response) -> Answer | float:
        """The answer, or after how long to ask again."""
        if response.is_success:
            return Answer(response.status_code, response.headers, response.content)
        status, headers, body = response.status_code, response.headers, response.content
        delay_s = self.patience.after_answer(call, tries, status, headers, body)
        if delay_s is None:
            raise Problem.read(status, body, self.url, retry_after_s(headers))
        return delay_s

    def silence(self, call: Call, tries: int, error: httpx.TransportError) -> float:
        """After how long to ask again where no answer came."""
        delay_s = self.patience.after_silence(call, tries)
        if delay_s is None:
            raise Unreachable(f"{self.url} did not answer {call.method} {call.path}: {error}") from error
        return delay_s


class Sync:
    """Drives operations, and waits."""

    def __init__(self, wire: Wire) -> None:
        self.wire = wire
        self.http = httpx.Client()

    def run(self, operation: Operation[T]) -> T:
        """What comes of the operation."""
        try:
            call = next(operation)
            while True:
                call = operation.send(self.answer(call))
        except StopIteration as end:
            result: T = end.value
            return result

    def entries(self, of: Listing) -> Iterator[dict[str, Any]]:
        """Every entry of a list; a page is asked for once the one before has been read."""
        token: str | None = None
        while True:
            page, token = self.run(of.page(token))
            yield from page
            if token is None:
                return

    def answer(self, call: Call) -> Answer:
        """The answer to one call, however often it had to be sent."""
        tries = 0
        while True:
            tries += 1
            try:
                if call.heard is not None:
                    return self._listen(call, call.heard)
                body = _body(call)
                answer = self.wire.read(call, tries, self.http.request(**self.wire.request(call), content=body))
            except httpx.TransportError as error:
                answer = self.wire.silence(call, tries, error)
            if isinstance(answer, Answer):
                return answer
            time.sleep(answer)

    def _listen(self, call: Call, heard: Callable[[str], None]) -> Answer:
        with suppress(httpx.TransportError), self.http.stream(**self.wire.stream(call)) as response:
            if response.is_success:
                for line in response.iter_lines():
                    heard(line)
        return ENDED


class Async:
    """Drives operations, and awaits."""

    def __init__(self, wire: Wire) -> None:
        self.wire = wire
        self.http = httpx.AsyncClient()

    async def run(self, operation: Operation[T]) -> T:
        """What comes of the operation."""
        try:
            call = next(operation)
            while True:
                call = operation.send(await self.answer(call))
        except StopIteration as end:
            result: T = end.value
            return result

    async def entries(self, of: Listing) -> AsyncIterator[dict[str, Any]]:
        """Every entry of a list; a page is asked for once the one before has been read."""
        token: str | None = None
        while True:
            page, token = await self.run(of.page(token))
            for entry in page:
                yield entry
            if token is None:
                return

    async def answer(self, call: Call) -> Answer:
        """The answer to one call, however often it had to be sent."""
        tries = 0
        while True:
            tries += 1
            try:
                if call.heard is not None:
                    return await self._listen(call, call.heard)
                body = _async_body(call)
                answer = self.wire.read(call, tries, await self.http.request(**self.wire.request(call), content=body))
            except httpx.TransportError as error:
                answer = self.wire.silence(call, tries, error)
            if isinstance(answer, Answer):
                return answer
            await asyncio.sleep(answer)

    async def _listen(self, call: Call, heard: Callable[[str], None]) -> Answer:
        with suppress(httpx.TransportError):
            async with self.http.stream(**self.wire.stream(call)) as response:
                if response.is_success:
                    async for line in response.aiter_lines():
                        heard(line)
        return ENDED


def _body(call: Call) -> bytes | Iterator[bytes] | None:
    if isinstance(call.body, Path) or (call.sent and call.body):
        return _pieces(call)
    return call.body


def _async_body(call: Call) -> bytes | AsyncIterator[bytes] | None:
    body = _body(call)
    return _awaited(body) if isinstance(body, Iterator) else body


def _pieces(call: Call) -> Iterator[bytes]:
    """The body, told on the way."""
    done = 0
    with _opened(call.body) as (file, total):
        while piece := file.read(CHUNK_BYTES):
            yield piece
            done += len(piece)
            if call.sent is not None:
                call.sent(done, total)


async def _awaited(pieces: Iterator[bytes]) -> AsyncIterator[bytes]:
    while (piece := await asyncio.to_thread(next, pieces, None)) is not None:
        yield piece


@contextmanager
def _opened(body: bytes | Path | None) -> Iterator[tuple[BinaryIO, int]]:
    if isinstance(body, Path):
        with body.open("rb") as file:
            yield file, body.stat().st_size
    else:
        yield io.BytesIO(body or b""), len(body or b"")
