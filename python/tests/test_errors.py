"""What goes wrong, and what is tried again."""

from __future__ import annotations

import http.server
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import httpx
import pytest
from conftest import Server
from traffic import events, frame, windows

from headway import Client, Patience, Problem, Unreachable

SOON = Patience(retries=2, first_s=0.01)
Handler = http.server.BaseHTTPRequestHandler


@contextmanager
def between(answer: Callable[[Handler, int, bytes], None]) -> Iterator[str]:
    """A server that answers as it is told; it counts its requests from 1."""
    count = 0

    class Between(Handler):
        protocol_version = "HTTP/1.1"

        def answer(self) -> None:
            nonlocal count
            count += 1
            body = self.rfile.read(int(self.headers.get("content-length", 0)))
            answer(self, count, body)

        do_GET = do_POST = answer

        def log_message(self, *_: Any) -> None:
            pass

    listening = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Between)
    threading.Thread(target=listening.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{listening.server_address[1]}"
    listening.shutdown()


def say(handler: Handler, status: int, body: bytes, **headers: str) -> None:
    handler.send_response(status)
    for name, value in {**headers, "content-length": str(len(body))}.items():
        handler.send_header(name.replace("_", "-"), value)
    handler.end_headers()
    handler.wfile.write(body)


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
        sent = {name: value for name, value in handler.headers.items() if name.lower() not in ("host", "connection")}
        keys.append(sent.get("idempotency-key"))
        answer = httpx.request(handler.command, server.url + handler.path, content=body, headers=sent)
        if count == 1:
            handler.connection.shutdown(socket.SHUT_RDWR)
            handler.close_connection = True
        else:
            say(handler, answer.status_code, answer.content)

    with between(loses) as url:
        batch = Client(url, patience=SOON).model().upload(frame("e", 12.0))
    assert (batch.accepted, batch.duplicates) == (12, 0), "the answer is the first one's"
    assert len(keys) == 2 and keys[0] == keys[1] is not None
    assert len(httpx.get(f"{server.url}/v1/models/default/batches").json()["batches"]) == 1


def test_what_has_no_key_is_not_sent_twice(server: Server) -> None:
    asked = []

    def cuts(handler: Handler, count: int, _: bytes) -> None:
        asked.append(count)
        handler.connection.shutdown(socket.SHUT_RDWR)
        handler.close_connection = True

    window = {"follower_speed_mps": [9.0] * 5, "leader_speed_mps": [9.0] * 5, "spacing_m": [20.0] * 5}
    with between(cuts) as url, pytest.raises(Unreachable):
        Client(url, patience=SOON).model().simulate(window, [9.0])
    assert asked == [1]
