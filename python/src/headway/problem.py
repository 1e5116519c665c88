"""Errors that carry what the server said."""

from __future__ import annotations

import json
import re
from typing import Any


class HeadwayError(Exception):
    """Anything that went wrong between this client and a server."""


class Unreachable(HeadwayError):
    """No answer came, however often it was asked for."""


class TaskFailed(HeadwayError):
    """A task ended without a version; `task` has its state and its error."""

    def __init__(self, task: dict[str, Any]) -> None:
        error = task.get("error") or {}
        why = f": {error.get('code')}: {error.get('detail')}" if error else ""
        super().__init__(f"task {task.get('task_id')} has {task.get('state')}{why}")
        self.task = task

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.task,)


class Problem(HeadwayError):
    """A refusal, as the server described it (RFC 9457)."""

    def __init__(self, status: int, body: dict[str, Any], url: str = "", retry_after_s: float | None = None) -> None:
        self._url = url
        self.status = status
        """The status of the answer."""
        self.body = body
        """Everything the server said."""
        self.code = str(body.get("code", ""))
        """A stable name, to decide by."""
        self.title = str(body.get("title", ""))
        self.detail = str(body.get("detail", ""))
        self.errors: list[dict[str, Any]] = list(body.get("errors") or body.get("rejected") or [])
        """Each place in the request that was wrong: `pointer`, `line`, `row` or `parameter`; `code`; `detail`."""
        self.retry_after_s = retry_after_s
        """After how long the server asked for another try, where it did."""
        self.request_id = str(body.get("request_id", ""))
        """What the server's log calls the request."""
        self.remedy_url = url + str(body.get("type", "")) if body.get("type") else ""
        """Where the server says what to do about it."""
        first = "; ".join(f"{error.get('code')}: {error.get('detail')}" for error in self.errors[:3])
        told = f"{self.title or 'refused'}: {self.detail}"
        super().__init__(f"{status} {self.code}: {told}" + (f" ({first})" if first else ""))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.status, self.body, self._url, self.retry_after_s)

    @classmethod
    def read(cls, status: int, body: bytes, url: str, retry_after_s: float | None = None) -> Problem:
        """A problem, an error of the inference protocol, or whatever else stands between: a proxy's page."""
        try:
            said = json.loads(body)
        except ValueError:
            said = None
        if not isinstance(said, dict):
            return cls(status, {"detail": body[:200].decode("utf-8", "replace")}, url, retry_after_s)
        if "error" in said and "code" not in said:
            # The inference protocol has a text alone; ours ends with `(code, request id)`.
            ending = re.search(r"^(.*) \((\w+), request (\S+)\)$", str(said["error"]), re.DOTALL)
            detail, code, request_id = ending.groups() if ending else (str(said["error"]), "", "")
            said = {"detail": detail, "code": code, "request_id": request_id}
            if code:
                said["type"] = f"/problems/{code}"
        return cls(status, said, url, retry_after_s)
