"""Marks of tests for what can be installed or left out."""

import importlib.util

import pytest

needs_omnisafe = pytest.mark.skipif(
    importlib.util.find_spec("omnisafe") is None,
    reason="OmniSafe is optional and not installed here; make venv installs it (requirements/omnisafe.txt)",
)
