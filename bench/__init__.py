"""Running and judging: specifications, records, evaluation, statistics and tables."""
