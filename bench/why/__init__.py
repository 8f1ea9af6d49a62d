"""Where a figure comes from: the records, seeds, commits and query behind a cell, computed again from them."""

from bench.why.address import Address, parse
from bench.why.trace import Trace, as_text, as_values, trace

__all__ = ["Address", "Trace", "as_text", "as_values", "parse", "trace"]
