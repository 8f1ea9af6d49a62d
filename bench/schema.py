"""Columns of the Parquet files of a record, and their bytes.

`train_episodes.parquet` (in order of completion) and `eval_episodes.parquet` (in order of episode number)
hold one row for each finished episode with the columns of `envs.world.EPISODE`, documented there: numbers as
32-bit floats rounded to 16 significant bits (relative error at most 2^-17), counts as the smallest integer that
holds them.
`scalars.parquet` holds what the learner reported: one row for each step and name.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from bench.errors import RecordError
from envs.world import EPISODE, Records

TABLES_VERSION: Final = 2
"""Raised by every change of a column; stored in each file."""
_VERSION_KEY: Final = b"safedrive_bench_tables"
_ROW_GROUP: Final = 1 << 20
_COUNTERS: Final = ("episode", "end_step")
"""Columns that hardly ever fall: their differences are stored."""

# An episode has at most 900 steps; enumerations and flags fit a byte.
_NARROW: Final[dict[str, pa.DataType]] = {
    **dict.fromkeys(("ending", "fault", "ego_at_fault"), pa.int8()),
    **dict.fromkeys(
        ("steps", "interventions", "altered", "steps_inside_safe_gap", "steps_low_ttc", "steps_hard_braking",
         "lane_changes", "world"),
        pa.int16(),
    ),
}  # fmt: skip


def _arrow_type(name: str) -> pa.DataType:
    if name in _NARROW:
        return _NARROW[name]
    return pa.float32() if EPISODE[name].kind == "f" else pa.int32()


_METADATA: Final = {_VERSION_KEY: str(TABLES_VERSION).encode()}
EPISODES: Final = pa.schema(
    [pa.field(name, _arrow_type(name), nullable=False) for name in EPISODE.names or ()], _METADATA
)
SCALARS: Final = pa.schema(
    [
        pa.field("steps", pa.int64(), nullable=False),  # simulation steps of 0.1 s done
        pa.field("name", pa.string(), nullable=False),
        pa.field("value", pa.float64(), nullable=False),
    ],
    _METADATA,
)


def episodes_table(episodes: Records) -> pa.Table:
    """`EPISODE` records as a table.

    Raises:
        pyarrow.ArrowInvalid: A count does not fit its column.
    """
    columns = [
        _narrowed(episodes[field.name], field)
        if pa.types.is_integer(field.type)
        else _array(rounded(episodes[field.name]), field.type)
        for field in EPISODES
    ]
    return pa.Table.from_arrays(columns, schema=EPISODES)


def rounded(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
    """32-bit floats with 16 significant bits, half away from zero: noise in the last digits does not compress."""
    bits = values.astype(np.float32).view(np.uint32)
    return ((bits + np.uint32(0x80)) & np.uint32(0xFFFFFF00)).view(np.float32)


def scalars_table(rows: Sequence[tuple[int, str, float]]) -> pa.Table:
    """What a learner reported, as (simulation steps, name, value)."""
    steps, names, values = zip(*rows, strict=True) if rows else ((), (), ())
    texts = [name.encode() for name in names]
    ends = np.cumsum([0, *map(len, texts)], dtype=np.int32)
    columns = [
        _array(np.array(steps, dtype=np.int64), pa.int64()),
        pa.StringArray.from_buffers(len(texts), pa.py_buffer(ends), pa.py_buffer(b"".join(texts)), null_count=0),
        _array(np.array(values, dtype=np.float64), pa.float64()),
    ]
    return pa.Table.from_arrays(columns, schema=SCALARS)


# `pyarrow.array` and `to_numpy` import pandas to see whether they were given some of it: 0.3 s of CPU in each worker
# and at the end of each command. Buffers need none.
def _array(values: npt.NDArray[Any], kind: pa.DataType) -> pa.Array:
    return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(np.ascontiguousarray(values))], null_count=0)


def _narrowed(values: npt.NDArray[Any], field: pa.Field) -> pa.Array:
    narrow = values.astype(field.type.to_pandas_dtype())
    if not np.array_equal(narrow, values):
        raise pa.ArrowInvalid(f"{field.name}: a count does not fit {field.type}")
    return _array(narrow, field.type)


def to_bytes(table: pa.Table) -> bytes:
    """Parquet file of a table: the same table gives the same bytes."""
    floats = [field.name for field in table.schema if pa.types.is_floating(field.type)]
    sink = io.BytesIO()
    pq.write_table(
        table,
        sink,
        row_group_size=_ROW_GROUP,
        compression="zstd",
        compression_level=9,
        use_dictionary=[name for name in table.schema.names if name not in {*floats, *_COUNTERS}],
        use_byte_stream_split=floats,
        column_encoding={name: "DELTA_BINARY_PACKED" for name in _COUNTERS if name in table.schema.names},
        version="2.6",
        data_page_version="1.0",
        write_page_index=False,
    )
    return sink.getvalue()


def from_bytes(content: bytes, expected: pa.Schema, where: str) -> pa.Table:
    """The table in a Parquet file.

    Args:
        content: The file.
        expected: `EPISODES` or `SCALARS`.
        where: Named in errors.

    Raises:
        RecordError: It is unreadable, or has other columns.
    """
    try:
        # No read_table: its scanner starts threads that may abort a process that ends at once (apache/arrow 34314).
        table = pq.ParquetFile(pa.BufferReader(content)).read(use_threads=False)
    except (pa.ArrowInvalid, OSError) as error:
        raise RecordError(f"{where} is not readable ({error}): remove its folder and run it again.") from error
    found = (table.schema.metadata or {}).get(_VERSION_KEY, b"none").decode()
    if not table.schema.equals(expected):
        raise RecordError(
            f"{where} has tables of version {found}, this project reads version {TABLES_VERSION}: "
            "remove its folder and run it again, or use the version of the project that wrote it."
        )
    return table


def column(table: pa.Table, name: str) -> npt.NDArray[Any]:
    """A column as an array."""
    chunked = table.column(name)
    if not (pa.types.is_integer(chunked.type) or pa.types.is_floating(chunked.type)) or chunked.null_count:
        values: npt.NDArray[Any] = chunked.to_numpy()
        return values
    dtype = np.dtype(chunked.type.to_pandas_dtype())
    chunks = [
        np.frombuffer(chunk.buffers()[1], dtype, len(chunk), chunk.offset * dtype.itemsize)
        for chunk in chunked.chunks
        if len(chunk)
    ]
    return np.concatenate(chunks) if chunks else np.empty(0, dtype)
