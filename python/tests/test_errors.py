"""What goes wrong, and what is tried again."""

from __future__ import annotations

import pickle
import socket
from collections.abc import Callable, Iterator
from email.utils import formatdate
from pathlib import Path

import httpx
import numpy as np
import pytest
from between import SOON, Handler, between, cut, headers_of, say
from conftest import Server, running
from traffic import events, frame, windows

from headway import Client, Patience, Problem, TaskFailed, Unreachable
from headway.calls import Call

CALL = Call("GET", "/v1/models")


def test_a_problem_carries_what_the_server_said(client: Client) -> None:
    with pytest.raises(Problem) as absent:
        client.model("nobody").info()
    problem = absent.value
    assert (problem.status, problem.code) == (404, "model_not_found") and "nobody" in str(problem)
    assert problem.request_id and httpx.get(problem.remedy_url).status_code == 200
    with pytest.raises(Problem) as unusable:
        client.create_model("m", settings={"hidden": -1, "colour": "red"})
    assert unusable.value.code == "invalid_body" or unusable.value.errors
    with pytest.raises(Problem) as rejected:
        client.model().upload([{**events("e", 12.0, 1)[0], "spacing_m": [-1.0] * 40}])
    assert rejected.value.status == 422 and rejected.value.errors[0]["code"] == "spacing_not_positive"
    # The inference protocol has errors of its own; they are read as problems.
    with pytest.raises(Problem) as early:
        client.model().predict(windows(1))
    assert (early.value.status, early.value.code) == (409, "no_live_version") and early.value.request_id


def test_keys_open_what_they_are_for(server: Server) -> None:
    made = httpx.post(f"{server.url}/v1/keys", json={"scopes": ["admin"]}).json()["key"]
    header = {"authorization": f"Bearer {made}"}
    narrow = httpx.post(f"{server.url}/v1/keys", json={"scopes": ["predict"]}, headers=header).json()["key"]
    with pytest.raises(Problem) as stranger:
        Client(server.url).models()
    assert (stranger.value.status, stranger.value.code) == (401, "unauthenticated")
    with pytest.raises(Problem) as lacking:
        Client(server.url, key=narrow).model().upload(frame("e", 12.0))
    assert lacking.value.code == "insufficient_scope"
    assert Client(server.url, key=made).model().upload(frame("e", 12.0)).accepted == 12


def test_what_is_no_address_is_said_at_once() -> None:
    with pytest.raises(ValueError, match="neither http:// nor https://"):
        Client("127.0.0.1:8080")


def test_who_does_not_answer_is_unreachable() -> None:
    with pytest.raises(Unreachable, match=r"127\.0\.0\.1:1 did not answer GET /v1/models"):
        Client("http://127.0.0.1:1", patience=SOON).models()


def test_a_busy_server_is_asked_again_and_a_refusal_is_not() -> None:
    def busy(handler: Handler, count: int, _: bytes) -> None:
        page = b'{"models": [], "next_page_token": null}'
        say(handler, 503 if count == 1 else 200, b"{}" if count == 1 else page, retry_after="0")

    with between(busy) as url:
        assert Client(url, patience=SOON).models() == []
    asked = []

    def refuses(handler: Handler, count: int, _: bytes) -> None:
        asked.append(count)
        say(handler, 422, b"no json at all")

    with between(refuses) as url, pytest.raises(Problem, match="no json at all"):
        Client(url, patience=SOON).models()
    assert asked == [1]
    counted = []

    def always(handler: Handler, count: int, _: bytes) -> None:
        counted.append(count)
        say(handler, 503, b"{}")

    with between(always) as url, pytest.raises(Problem):
        Client(url, patience=SOON).models()
    assert counted == [1, 2, 3]


def test_an_answer_that_was_lost_is_asked_for_again_and_done_once(server: Server) -> None:
    keys = []

    def loses(handler: Handler, count: int, body: bytes) -> None:
        # The server does it, and the first answer is cut off.
        sent = headers_of(handler)
        keys.append(sent.get("idempotency-key"))
        answer = httpx.request(handler.command, server.url + handler.path, content=body, headers=sent)
        if count == 1:
            cut(handler)
        else:
            say(handler, answer.status_code, answer.content)

    with between(loses) as url:
        batch = Client(url, patience=SOON).model().upload(frame("e", 12.0))
    assert (batch.accepted, batch.duplicates) == (12, 0), "the answer is the first one's"
    assert len(keys) == 2 and keys[0] == keys[1] is not None
    assert len(httpx.get(f"{server.url}/v1/models/default/batches").json()["batches"]) == 1


def test_what_may_not_be_repeated_is_not_sent_twice() -> None:
    asked = []

    def cuts(handler: Handler, count: int, _: bytes) -> None:
        asked.append(count)
        cut(handler)

    with between(cuts) as url, pytest.raises(Unreachable):
        Client(url, patience=SOON)._transport.answer(Call("POST", "/", repeatable=False))
    assert asked == [1]


def test_who_asks_again_while_the_first_is_being_answered_gets_its_answer(server: Server) -> None:
    # The first request reaches the server but for its body, and the client's connection breaks; the second finds the
    # first still being answered, which then gets its body; the third gets the first one's answer.
    seen: list[int] = []
    rest: list[bytes] = []
    first = socket.create_connection(("127.0.0.1", int(server.url.rsplit(":", 1)[1])))

    def overtakes(handler: Handler, count: int, body: bytes) -> None:
        headers = headers_of(handler)
        if count == 1:
            head = {"host": "headway", "connection": "close", "expect": "100-continue", **headers}
            lines = "".join(f"{name}: {value}\r\n" for name, value in head.items())
            first.sendall(f"POST {handler.path} HTTP/1.1\r\n{lines}\r\n".encode())
            # The server asks for a body once it has noted the key.
            assert first.recv(65536).startswith(b"HTTP/1.1 100")
            rest.append(body)
            cut(handler)
            return
        answer = httpx.post(server.url + handler.path, content=body, headers=headers)
        seen.append(answer.status_code)
        if answer.status_code == 409:
            first.sendall(rest.pop())
            while first.recv(65536):
                pass
        say(handler, answer.status_code, answer.content, retry_after="0")

    with first, between(overtakes) as url:
        batch = Client(url, patience=SOON).model().upload(frame("e", 12.0))
    assert seen == [409, 201] and (batch.accepted, batch.duplicates) == (12, 0)
    assert len(httpx.get(f"{server.url}/v1/models/default/batches").json()["batches"]) == 1


def test_a_longer_wait_than_patience_has_is_left_to_the_caller() -> None:
    asked = []

    def later(handler: Handler, count: int, _: bytes) -> None:
        asked.append(count)
        say(handler, 503, b"{}", retry_after="3600")

    with between(later) as url, pytest.raises(Problem) as busy:
        Client(url, patience=SOON).models()
    assert asked == [1] and busy.value.retry_after_s == 3600
    dated = {"retry-after": formatdate(0, usegmt=True)}
    assert Patience().after_answer(CALL, 1, 503, dated) == 0
    assert 0.1 <= (Patience().after_answer(CALL, 1, 503, {"retry-after": "soon"}) or 0) <= 0.2


def test_errors_go_from_one_process_to_another() -> None:
    problem = Problem(404, {"code": "model_not_found", "type": "/problems/model_not_found"}, "http://there", 3.0)
    for error in [problem, TaskFailed({"task_id": "t1", "state": "cancelled"}), Unreachable("nobody")]:
        again = pickle.loads(pickle.dumps(error))
        assert type(again) is type(error) and str(again) == str(error)
    again = pickle.loads(pickle.dumps(problem))
    assert (again.remedy_url, again.retry_after_s) == (problem.remedy_url, 3.0)


@pytest.fixture
def strict(tmp_path: Path) -> Iterator[Server]:
    with running(tmp_path, "server.predict_windows_max=4", "ingest.max_body_bytes=100000") as server:
        yield server


def test_every_kind_of_refusal_is_a_problem_with_its_code(strict: Server, tmp_path: Path) -> None:
    client = Client(strict.url)
    model = client.model()
    only_tests = [{**event, "split": "test"} for event in events("t", 9.0)]

    def refused(status: int, code: str, ask: Callable[[], object]) -> None:
        with pytest.raises(Problem) as problem:
            ask()
        assert (problem.value.status, problem.value.code) == (status, code), problem.value
        assert problem.value.request_id and problem.value.remedy_url == f"{strict.url}/problems/{code}"

    refused(409, "nothing_pending", model.train)
    refused(409, "no_live_version", lambda: model.rollback(reason="none"))
    refused(404, "version_not_found", lambda: model.evaluation(7))
    refused(404, "batch_not_found", lambda: model.events("b9"))
    refused(409, "model_exists", lambda: client.create_model("default"))
    refused(422, "invalid_query", lambda: model.upload(frame("e", 12.0), colour="red"))
    refused(422, "no_event_accepted", lambda: model.upload([]))
    refused(422, "invalid_body", lambda: model.upload(frame("e", 12.0).sort_values("t")))
    (tmp_path / "cut.parquet").write_bytes(b"PAR1")
    refused(400, "truncated_body", lambda: model.upload(tmp_path / "cut.parquet"))
    refused(413, "body_too_large", lambda: model.upload(events("long", 12.0, 200)))
    model.upload(only_tests, regime="fast")
    with pytest.raises(TaskFailed, match="no_training_events") as failed:
        model.train()
    assert failed.value.task["state"] == "failed"
    model.upload(frame("e", 12.0), regime="fast")
    model.train()
    refused(409, "no_parent_version", lambda: model.rollback(reason="none"))
    refused(422, "invalid_body", lambda: model.predict(windows(5)))
    refused(422, "invalid_body", lambda: model.predict(windows(1, horizon=7)))
    refused(422, "invalid_body", lambda: model.predict(windows(1) * np.nan))
    refused(404, "version_not_found", lambda: model.predict(windows(1), version=7))


@pytest.fixture
def slow(tmp_path: Path) -> Iterator[Server]:
    with running(tmp_path, "access.rate_requests=3", "access.rate_window_s=1") as server:
        yield server


def test_who_asks_too_often_comes_back_when_told(slow: Server) -> None:
    key = httpx.post(f"{slow.url}/v1/keys", json={"scopes": ["admin"]}).json()["key"]
    hasty = Client(slow.url, key=key, patience=Patience(retries=0))
    with pytest.raises(Problem) as many:
        for _ in range(1000):
            hasty.models()
    assert (many.value.status, many.value.code) == (429, "rate_limited") and many.value.retry_after_s is not None
    patient = Client(slow.url, key=key)
    assert [len(patient.models()) for _ in range(6)] == [1] * 6
