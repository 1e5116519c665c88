"""Where everybody was, and how fast: time-space diagrams, in which waves are stripes. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from measures import Measures


def draw(roads: Mapping[str, Mapping[str, Measures]], to: Path) -> None:
    """A row for each road, a column for each driver."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    # Few colours and hard edges, for a small file.
    colours = colormaps["turbo_r"].resampled(12)
    columns = max(len(drivers) for drivers in roads.values())
    figure = Figure(figsize=(3.2 * columns, 2.6 * len(roads)), layout="constrained")
    axes = figure.subplots(len(roads), columns, squeeze=False, sharex="row", sharey="row")
    for row, (road, drivers) in zip(axes, roads.items(), strict=True):
        most_mps = max(seen.speed_mps for measures in drivers.values() for seen in measures.seen)
        for axis, (who, measures) in zip(row, drivers.items(), strict=False):
            times_s, _, places_m, speeds_mps = zip(*measures.seen, strict=True)
            look = {"s": 0.5, "linewidths": 0, "antialiased": False, "cmap": colours, "vmin": 0, "vmax": most_mps}
            dots = axis.scatter(times_s, places_m, c=speeds_mps, rasterized=True, **look)
            axis.set(title=f"{road}, {who}", xlabel="time, s")
        row[0].set_ylabel("place, m")
        figure.colorbar(dots, ax=row.tolist(), label="speed, m/s")
    figure.savefig(to, dpi=90)
