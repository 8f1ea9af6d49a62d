"""The paper's claims C1 to C5, tested on our records; rules in ``docs/claims.md``."""

from bench.claims.command import as_text, as_values, judge, write
from bench.claims.verdict import Claim, Part, Verdict

__all__ = ["Claim", "Part", "Verdict", "as_text", "as_values", "judge", "write"]
