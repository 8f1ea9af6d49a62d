"""Tables of a record: no pandas behind them, nothing lost on the way, nothing that does not fit."""

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest

from bench import schema
from envs.world import EPISODE


def test_tables_are_written_and_read_without_pandas() -> None:
    code = """
import sys
import numpy as np
from bench import schema
from envs.world import EPISODE
for table in (schema.episodes_table(np.zeros(3, EPISODE)), schema.scalars_table([(10, "loss", 0.5)])):
    read = schema.from_bytes(schema.to_bytes(table), table.schema, "here")
    schema.column(read, "steps")
print("pandas" in sys.modules)
"""
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "False\n"


def test_scalars_are_those_of_a_table_made_by_pyarrow_byte_for_byte() -> None:
    rows = [(10, "loss", 0.5), (10, "", -1.0), (20, "Güte", float("nan"))]
    steps, names, values = (list(column) for column in zip(*rows, strict=True))
    table = pa.table({"steps": steps, "name": names, "value": values}, schema=schema.SCALARS)
    assert schema.to_bytes(schema.scalars_table(rows)) == schema.to_bytes(table)
    assert schema.column(table, "name").tolist() == names


def test_a_column_of_several_slices_is_whole() -> None:
    table = schema.scalars_table([(step, "loss", 0.5 * step) for step in range(10)])
    pieces = pa.concat_tables([table.slice(0, 3), table.slice(3, 0), table.slice(3, 7)])
    np.testing.assert_array_equal(schema.column(pieces, "value"), 0.5 * np.arange(10))
    assert schema.column(table.slice(0, 0), "steps").dtype == np.int64


def test_a_count_that_does_not_fit_is_refused() -> None:
    episodes = np.zeros(2, EPISODE)
    episodes["lane_changes"] = 2**15
    with pytest.raises(pa.ArrowInvalid, match="lane_changes"):
        schema.episodes_table(episodes)
