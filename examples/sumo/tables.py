"""Figures of several runs, in Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

Runs = Sequence[Mapping[str, float]]
"""The figures of each run of one driver."""


def table(drivers: Mapping[str, Runs]) -> str:
    """A column for each driver, and in it the mean of its runs and their standard deviation, where they differ."""
    names = list(dict.fromkeys(name for runs in drivers.values() for name in runs[0]))
    lines = ["", "| | " + " | ".join(drivers) + " |", "| --- " * (len(drivers) + 1) + "|"]
    for name in names:
        cells = [told([run[name] for run in runs if name in run]) for runs in drivers.values()]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join([*lines, ""])


def told(values: Sequence[float]) -> str:
    """The mean of some runs, with their spread where there is one."""
    if not values:
        return "–"
    mean = float(np.mean(values))
    whole = all(value == values[0] == round(value) for value in values)
    digits = 0 if whole or abs(mean) >= 100 else 1 if abs(mean) >= 10 else 2
    spread = f"{np.std(values, ddof=1):.{digits}f}" if len(values) > 1 else "0"
    return f"{mean:.{digits}f}" + (f" ± {spread}" if float(spread) else "")
