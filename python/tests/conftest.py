"""The real server, with a database of its own."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from headway import Client

ROOT = Path(__file__).resolve().parents[2]
BINARY = Path(os.environ.get("HEADWAY_BINARY", ROOT / "target/debug/headway"))
# Small and quick, and no limit met before what is looked for.
SETTINGS = [
    "model.hidden=6",
    "model.horizon=5",
    "model.epochs=1",
    "model.minibatch=8",
    "model.schedule=manual",
    "model.promotion=auto",
    "training.training_threads=1",
    "access.rate_requests=0",
    "access.rate_predictions=0",
]


@dataclass
class Server:
    """A running server."""

    url: str
    process: subprocess.Popen[str]

    def stop(self) -> None:
        """Ends it, as it ends by itself."""
        self.process.send_signal(signal.SIGTERM)
        with self.process:
            assert self.process.wait() == 0


def start(folder: Path, *others: str) -> Server:
    """A server on a free port, on the database in this folder."""
    settings = [part for setting in [*SETTINGS, *others] for part in ("--set", setting)]
    command = [str(BINARY), "--listen", "127.0.0.1:0", "--database", str(folder / "headway.db"), *settings]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    told = process.stdout.readline()
    assert told.startswith("listening on "), f"{command} did not start"
    return Server(told.removeprefix("listening on ").strip(), process)


@contextmanager
def running(folder: Path, *others: str) -> Iterator[Server]:
    """A server, for as long as it is needed."""
    server = start(folder, *others)
    try:
        yield server
    finally:
        server.stop()


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    with running(tmp_path) as server:
        yield server


@pytest.fixture
def client(server: Server) -> Iterator[Client]:
    with Client(server.url) as client:
        yield client


def url_of(client: Client) -> str:
    """The address of a client's server."""
    return client._transport.wire.url
