"""When a call is sent again, and after how long."""

from __future__ import annotations

import json
import random
import time
from collections.abc import Mapping
from dataclasses import dataclass
from email.utils import parsedate_to_datetime

from .calls import Call

NOT_DONE = frozenset({429, 503})
"""Answers that say nothing was done, and may be otherwise later."""
UNKNOWN = frozenset({502, 504})
"""Answers of what stands between, which does not know whether anything was done."""


@dataclass(frozen=True)
class Patience:
    """How often, and how long, a call that was not answered is tried."""

    retries: int = 5
    """Most times that a call is sent again."""
    first_s: float = 0.2
    """Delay before the second try; each further one is twice as long."""
    longest_s: float = 20.0
    """No delay is longer: where the server asks for more, the call is not sent again."""

    def after_answer(
        self, call: Call, tries: int, status: int, headers: Mapping[str, str], body: bytes = b""
    ) -> float | None:
        """Seconds until the call is sent again, or none where it is not."""
        again = status in NOT_DONE or (call.repeatable and status in UNKNOWN) or being_answered(status, body)
        if tries > self.retries or not again:
            return None
        asked_s = retry_after_s(headers)
        if asked_s is None:
            return self._delay_s(tries)
        # Earlier than it was asked for, it would only be refused again.
        return asked_s if asked_s <= self.longest_s else None

    def after_silence(self, call: Call, tries: int) -> float | None:
        """As `after_answer`, where a connection was refused or broke."""
        return None if tries > self.retries or not call.repeatable else self._delay_s(tries)

    def _delay_s(self, tries: int) -> float:
        # Up to half of it by chance, so that clients that failed together do not come back together.
        return float(min(self.first_s * 2 ** (tries - 1), self.longest_s) * random.uniform(0.5, 1.0))


def being_answered(status: int, body: bytes) -> bool:
    """Whether the same call, sent before, is still being answered: what it comes to is there for who asks again.

    No other refusal with a status of 4xx but 429 is worth a second try.
    """
    if status != 409:
        return False
    try:
        said = json.loads(body)
    except ValueError:
        return False
    return isinstance(said, dict) and said.get("code") == "idempotency_in_flight"


def retry_after_s(headers: Mapping[str, str]) -> float | None:
    """How long the server asks to wait: a number of seconds, or a date, as what stands between may write it."""
    asked = headers.get("retry-after", "").strip()
    if asked.isdecimal():
        return float(asked)
    try:
        return max(0.0, parsedate_to_datetime(asked).timestamp() - time.time())
    except ValueError:
        return None
