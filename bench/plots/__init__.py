"""Figures from records: one style, colours that colour-blind readers tell apart, PDF and PNG with the same bytes."""

from bench.plots.command import write

__all__ = ["write"]
