"""The contract of a method as executable checks: ``bench check NAME``."""

from bench.contract.checks import NAMES, Check, Report, check_method

__all__ = ["NAMES", "Check", "Report", "check_method"]
