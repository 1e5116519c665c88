"""Room for those who join: whoever is first behind a joining vehicle follows it, too, before it is on the lane."""

from __future__ import annotations

from bisect import bisect_right

from network import VEHICLE_LENGTH_M, Merge

ZONE_M = 150.0
"""So far before the two streams meet room is made."""

COURTESY_MPS2 = 2.0
"""Nobody brakes harder than this to make room."""


def those_who_join(merge: Merge, places: dict[str, tuple[str, float]]) -> dict[str, tuple[str, float]]:
    """Who makes room for whom, and the spacing between them as if they were on one lane.

    `places` are the lane of each vehicle and its front's position on it. As in the literature on cooperative merging
    (Uno et al. 1999; Lu and Hedrick 2003) the joining vehicle is projected on the lane that it will be on.
    """

    def along(begins: dict[str, float]) -> list[tuple[float, str]]:
        return sorted((begins[lane] + at_m, name) for name, (lane, at_m) in places.items() if lane in begins)

    through = along(merge.through)
    found: dict[str, tuple[str, float]] = {}
    for front_m, name in along(merge.joining):
        rear_m = front_m - VEHICLE_LENGTH_M
        behind = bisect_right(through, (rear_m, "")) - 1
        if front_m >= -ZONE_M and behind >= 0:
            place_m, follower = through[behind]
            # Of several the nearest, who is the first.
            found.setdefault(follower, (name, rear_m - place_m))
    return found
