"""What is awaited is what is waited for."""

from __future__ import annotations

import asyncio
import inspect
import json
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

import httpx
import pandas as pd
import pytest
from between import SOON, Handler, between, cut, headers_of, say
from conftest import Server, url_of
from traffic import events, frame, windows

from headway import AsyncClient, AsyncModel, Client, Model, Problem, Unreachable


def run(what: Coroutine[Any, Any, Any]) -> Any:
    return asyncio.run(what)


@pytest.mark.parametrize(("waiting", "awaiting"), [(Client, AsyncClient), (Model, AsyncModel)])
def test_both_have_the_same_methods(waiting: type, awaiting: type) -> None:
    def public(of: type) -> dict[str, tuple[list[str], str | None]]:
        methods = {name: each for name, each in vars(of).items() if not name.startswith("_")}
        return {name: (told(each), each.__doc__) for name, each in methods.items()}

    def told(method: Any) -> list[str]:
        signature = inspect.signature(method)
        returned = str(signature.return_annotation).removeprefix("Async")
        return [*map(str, signature.parameters.values()), returned]

    assert public(waiting) == public(awaiting)


def test_every_answer_is_the_same(client: Client, tmp_path: Path) -> None:
    model = client.model()
    model.upload(frame("fast", 16.0), regime="fast")
    window = windows(1)[0]
    (tmp_path / "new.ndjson").write_text("".join(json.dumps(event) + "\n" for event in events("new", 14.0)))

    async def awaited() -> list[Any]:
        async with AsyncClient(url_of(client)) as there:
            other = there.model()
            await other.train()
            uploaded = await other.upload(tmp_path / "new.ndjson", regime="fast")
            assert (uploaded.accepted, uploaded.batch_id) == (12, "b2")
            return [
                await there.models(),
                await other.info(),
                await other.versions(),
                (await other.predict(windows(3))).accel_mps2.tolist(),
                (await other.simulate(window, [9.0] * 9)).spacing_m.tolist(),
                await other.evaluation(1),
                await other.forgetting(),
                await other.events("b2"),
                await other.evaluate(frame("new", 13.0), references=["idm"], regime="fast"),
                (await other.export(1, tmp_path / "there", format="safetensors")).read_bytes(),
            ]

    waited = [
        run(awaited()),
        [
            client.models(),
            model.info(),
            model.versions(),
            model.predict(windows(3)).accel_mps2.tolist(),
            model.simulate(window, [9.0] * 9).spacing_m.tolist(),
            model.evaluation(1),
            model.forgetting(),
            model.events("b2"),
            model.evaluate(frame("new", 13.0), references=["idm"], regime="fast"),
            model.export(1, tmp_path / "here", format="safetensors").read_bytes(),
        ],
    ]
    for there, here in zip(*waited, strict=True):
        if isinstance(here, pd.DataFrame):
            pd.testing.assert_frame_equal(there, here)
        else:
            assert there == here


def test_what_goes_wrong_is_the_same(server: Server, tmp_path: Path) -> None:
    async def asked(url: str) -> Any:
        async with AsyncClient(url, patience=SOON) as client:
            return await client.models()

    async def lacking() -> None:
        async with AsyncClient(server.url) as client:
            await client.model("nobody").info()

    with pytest.raises(Unreachable, match=r"127\.0\.0\.1:1 did not answer GET /v1/models"):
        run(asked("http://127.0.0.1:1"))
    with pytest.raises(Problem) as absent:
        run(lacking())
    assert absent.value.code == "model_not_found"

    def busy(handler: Handler, count: int, _: bytes) -> None:
        say(handler, 503 if count == 1 else 200, b'{"models": [], "next_page_token": null}', retry_after="0")

    with between(busy) as url:
        assert run(asked(url)) == []


def test_a_file_whose_answer_was_lost_is_sent_again_and_taken_once(server: Server, tmp_path: Path) -> None:
    keys = []
    frame("e", 12.0).to_csv(tmp_path / "e.csv", index=False)

    def loses(handler: Handler, count: int, body: bytes) -> None:
        keys.append(handler.headers["idempotency-key"])
        sent = {name: value for name, value in headers_of(handler).items() if name.lower() != "transfer-encoding"}
        answer = httpx.post(server.url + handler.path, content=body, headers=sent)
        if count == 1:
            cut(handler)
        else:
            say(handler, answer.status_code, answer.content)

    async def uploaded(url: str) -> Any:
        async with AsyncClient(url, patience=SOON) as client:
            return await client.model().upload(tmp_path / "e.csv")

    with between(loses) as url:
        batch = run(uploaded(url))
    assert (batch.accepted, batch.duplicates) == (12, 0)
    assert len(keys) == 2 and keys[0] == keys[1]
    assert len(httpx.get(f"{server.url}/v1/models/default/batches").json()["batches"]) == 1
