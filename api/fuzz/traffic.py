"""Events that any model accepts."""

import math


def followed(number, steps=40, dt_s=0.1):
    """Arrays of an event behind a leader whose speed swings; every number gives another."""
    phase = 0.6180339887498949 * number
    leader = [14 + math.sin(dt_s * k + phase) for k in range(steps)]
    follower = [14 + math.sin(dt_s * k + phase - 0.6) for k in range(steps)]
    gap_rate = [ahead - behind for ahead, behind in zip(leader, follower)]
    spacing = [20 + phase % 3]
    for before, after in zip(gap_rate, gap_rate[1:]):
        spacing.append(spacing[-1] + 0.5 * dt_s * (before + after))
    return {"dt_s": dt_s, "spacing_m": spacing, "follower_speed_mps": follower, "leader_speed_mps": leader,
            "rel_speed_mps": gap_rate}
