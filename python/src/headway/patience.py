"""When a call is sent again, and after how long."""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import dataclass

from .calls import Call

AGAIN = frozenset({429, 502, 503, 504})
"""Answers that say nothing was done, and may be otherwise later."""


@dataclass(frozen=True)
class Patience:
    """How often, and how long, a call that was not answered is tried."""

    retries: int = 5
    """Most times that a call is sent again."""
    first_s: float = 0.2
    """Delay before the second try; each further one is twice as long."""
    longest_s: float = 20.0
    """No delay is longer, whatever the server asks for."""

    def after_answer(self, call: Call, tries: int, status: int, headers: Mapping[str, str]) -> float | None:
        """Seconds until the call is sent again, or none where it is not."""
        if tries > self.retries or status not in AGAIN or not (call.repeatable or status in (429, 503)):
            return None
        asked = headers.get("retry-after", "")
        if asked.isdigit():
            return min(float(asked), self.longest_s)
        return self._delay_s(tries)

    def after_silence(self, call: Call, tries: int) -> float | None:
        """As `after_answer`, where a connection was refused or broke."""
        return None if tries > self.retries or not call.repeatable else self._delay_s(tries)

    def _delay_s(self, tries: int) -> float:
        # Up to half of it by chance, so that clients that failed together do not come back together.
        return float(min(self.first_s * 2 ** (tries - 1), self.longest_s) * random.uniform(0.5, 1.0))
