"""A server that answers as it is told, between a client and whatever it stands for."""

from __future__ import annotations

import http.server
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from headway import Patience

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
            if self.headers.get("transfer-encoding") == "chunked":
                while size := int(self.rfile.readline(), 16):
                    body += self.rfile.read(size)
                    self.rfile.readline()
                self.rfile.readline()
            answer(self, count, body)

        do_GET = do_POST = answer

        def log_message(self, *_: Any) -> None:
            pass

    listening = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Between)
    threading.Thread(target=listening.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{listening.server_address[1]}"
    finally:
        listening.shutdown()
        listening.server_close()


def say(handler: Handler, status: int, body: bytes, **headers: str) -> None:
    """Answers."""
    handler.send_response(status)
    for name, value in {**headers, "content-length": str(len(body))}.items():
        handler.send_header(name.replace("_", "-"), value)
    handler.end_headers()
    handler.wfile.write(body)


def cut(handler: Handler) -> None:
    """Ends the connection without an answer."""
    handler.connection.shutdown(socket.SHUT_RDWR)
    handler.close_connection = True


def headers_of(handler: Handler) -> dict[str, str]:
    """What goes on to the server behind."""
    return {name: value for name, value in handler.headers.items() if name.lower() not in ("host", "connection")}
