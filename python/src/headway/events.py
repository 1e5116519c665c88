"""Events as bodies of uploads: from data frames, Arrow tables, lists and files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from .calls import json_of

Events: TypeAlias = pd.DataFrame | pa.Table | Sequence[Mapping[str, Any]] | str | Path
"""A frame or table with a row for each step (`event_id`, `spacing_m`, `follower_speed_mps`, `leader_speed_mps`, and `t`
or a `dt_s` with the upload; rows of an event together), events as the interface writes them, or a file of any kind that
a server reads."""

MEDIA_TYPES = {
    ".json": "application/json",
    ".ndjson": "application/x-ndjson",
    ".jsonl": "application/x-ndjson",
    ".csv": "text/csv",
    ".parquet": "application/vnd.apache.parquet",
    ".npy": "application/x-npy",
    ".xml": "application/xml",
}
ENCODINGS = {".gz": "gzip", ".zst": "zstd"}


@dataclass(frozen=True)
class Body:
    """A body and the headers that say what it is."""

    content: bytes | Path
    headers: dict[str, str]


def body_of(events: Events) -> Body:
    """The body of an upload of these events."""
    if isinstance(events, (str, Path)):
        return _file(Path(events))
    if isinstance(events, pd.DataFrame):
        events = pa.Table.from_pandas(events, preserve_index=False)
    if isinstance(events, pa.Table):
        # A column with nothing in it has no type either, and would be written as numbers.
        events = events.drop_columns([field.name for field in events.schema if pa.types.is_null(field.type)])
        sink = pa.BufferOutputStream()
        pq.write_table(events, sink, compression="zstd")
        return Body(sink.getvalue().to_pybytes(), {"content-type": MEDIA_TYPES[".parquet"]})
    lines = b"".join(json_of(event) + b"\n" for event in events)
    return Body(lines, {"content-type": MEDIA_TYPES[".ndjson"]})


def _file(path: Path) -> Body:
    suffixes = [suffix.lower() for suffix in path.suffixes]
    encoding = ENCODINGS.get(suffixes[-1]) if suffixes else None
    kind = MEDIA_TYPES.get(suffixes[-2] if encoding and len(suffixes) > 1 else suffixes[-1]) if suffixes else None
    if kind is None:
        known = ", ".join(MEDIA_TYPES)
        raise ValueError(f"{path}: its name ends in none of {known}, with .gz or .zst or without")
    headers = {"content-type": kind}
    if encoding:
        headers["content-encoding"] = encoding
    return Body(path, headers)
