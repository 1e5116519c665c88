"""What is told while something goes on."""

from __future__ import annotations

import asyncio
import io
import json
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest
from between import SOON, Handler, between, cut, headers_of, say
from conftest import Server, url_of
from traffic import frame

from headway import AsyncClient, Client, Progress, TaskFailed


class Terminal(io.StringIO):
    """Takes what a terminal would show."""

    isatty = lambda _: True  # noqa: E731


def order(server: Server, what: str) -> None:
    """Asks the model for something that the client does not do."""
    httpx.post(f"{server.url}/v1/models/default/{what}").raise_for_status()


def test_training_is_told_as_it_goes(server: Server, client: Client) -> None:
    told: list[Progress] = []

    def tell(progress: Progress) -> None:
        told.append(progress)
        # While the model is paused its task waits: first the task is read, then the stream is open and says the same.
        if [each.state for each in told] == ["queued", "queued"]:
            order(server, "resume")

    model = client.model()
    model.upload(frame("fast", 16.0), regime="fast")
    order(server, "pause")
    assert model.train(settings={"epochs": 3}, progress=tell).version == 1
    assert {progress.regime for progress in told} == {"fast"} and {progress.task_id for progress in told} == {"t1"}
    assert [progress.share for progress in told] == sorted(progress.share for progress in told)
    assert (told[-1].state, told[-1].share) == ("succeeded", 1.0)


def test_every_event_of_a_stream_is_told(client: Client) -> None:
    model = client.model()
    model.upload(frame("fast", 16.0), regime="fast")
    made = httpx.get(f"{url_of(client)}/v1/models/default/versions/{model.train().version}").content
    task = {"task_id": "t1", "regime": "fast", "progress": 0.0, "version": 1}
    stream = (
        'event: progress\ndata: {"progress": 0.25, "epoch": 1, "seconds_left": 3.5}\n\n: nothing is new\n\n'
        f"event: task\ndata: {json.dumps({**task, 'state': 'running', 'progress': 0.5})}\n\n"
        'event:progress\ndata:{"progress": 0.75, "epoch": 3, "seconds_left": 1.0}\n\n'
    )

    def server(handler: Handler, count: int, _: bytes) -> None:
        if handler.command == "POST":
            say(handler, 201, b'{"task_ids": ["t1"]}')
        elif handler.path.endswith("/progress"):
            say(handler, 200, stream.encode())
        elif "/tasks/" in handler.path:
            state = "running" if count == 2 else "succeeded"
            say(handler, 200, json.dumps({**task, "state": state}).encode())
        else:
            say(handler, 200, made)

    told: list[Progress] = []
    with between(server) as url:
        Client(url, patience=SOON).model().train(progress=told.append)
    waited = [(each.state, each.share, each.raw.get("epoch")) for each in told]
    expected = [("running", 0.0, None), ("running", 0.25, 1), ("running", 0.5, None), ("running", 0.75, 3)]
    assert waited == [*expected, ("succeeded", 1.0, None)]

    async def awaited() -> list[Progress]:
        told: list[Progress] = []
        async with AsyncClient(url, patience=SOON) as there:
            await there.model().train(progress=told.append)
        return told

    with between(server) as url:
        assert asyncio.run(awaited()) == told


def test_who_awaits_is_told_too_and_a_cancelled_task_is_an_error(server: Server) -> None:
    async def awaited() -> list[str]:
        states: list[str] = []

        def told(progress: Progress) -> None:
            states.append(progress.state)
            if states == ["queued"]:
                order(server, f"tasks/{progress.task_id}/cancel")

        async with AsyncClient(server.url) as client:
            model = client.model()
            await model.upload(frame("fast", 16.0), regime="fast")
            order(server, "pause")
            with pytest.raises(TaskFailed, match="has cancelled") as ended:
                await model.train(progress=told)
            assert ended.value.task["state"] == "cancelled"
        return states

    states = asyncio.run(awaited())
    assert states[0] == "queued" and set(states[1:]) == {"cancelled"}


@pytest.mark.parametrize("spoil", [cut, lambda handler: say(handler, 503, b"{}")])
def test_training_ends_without_a_stream(server: Server, spoil: Callable[[Handler], None]) -> None:
    streams: list[int] = []

    def spoils(handler: Handler, count: int, body: bytes) -> None:
        if handler.path.endswith("/progress"):
            if not streams:
                order(server, "resume")
            streams.append(count)
            spoil(handler)
            return
        answer = httpx.request(handler.command, server.url + handler.path, content=body, headers=headers_of(handler))
        say(handler, answer.status_code, answer.content)

    told: list[Progress] = []
    with between(spoils) as url:
        model = Client(url, patience=SOON).model()
        model.upload(frame("fast", 16.0), regime="fast")
        order(server, "pause")
        assert model.train(progress=told.append).version == 1
    assert streams and told[-1].state == "succeeded"


def test_bars_are_for_terminals(client: Client, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    model, elsewhere, terminal = client.model(), io.StringIO(), Terminal()
    monkeypatch.setattr("sys.stderr", elsewhere)
    model.upload(frame("fast", 16.0), regime="fast")
    model.train()
    assert elsewhere.getvalue() == ""
    monkeypatch.setattr("sys.stderr", terminal)
    frame("slow", 6.0).to_csv(tmp_path / "slow.csv", index=False)
    assert model.upload(tmp_path / "slow.csv", regime="slow").accepted == 12
    assert "upload" not in terminal.getvalue(), "what is quick needs no bar"
    model.train(progress=False)
    assert terminal.getvalue() == ""
    model.upload(frame("middle", 10.0), regime="middle", progress=True)
    model.train()
    assert "middle: 100%" in terminal.getvalue()
