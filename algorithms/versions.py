"""Versions of what methods are made of; here, since a plan of runs needs them without the code that they stand for."""

from __future__ import annotations

from typing import Final

LEARNER_VERSION: Final = 2
"""Raised by every change of learner, constants or `SACSettings` that alters results; part of each version that rests
on it."""
GUARD_VERSION: Final = 4
"""Raised by every change that alters what the guard does; part of the version of every method behind it."""
RSS_VERSION: Final = 1
"""Raised by every change that alters what the RSS guard does; part of the version of the method behind it."""
AGENT_VERSION: Final = LEARNER_VERSION - 1
"""Of the trained driving agent: rises with the learner, and by one more with every other change that alters it."""
MODEL_VERSION: Final = 1
"""Raised by every change that alters the trained risk model."""
STEERED_VERSION: Final = GUARD_VERSION + AGENT_VERSION + MODEL_VERSION
"""Of SAC behind a guard that a risk model steers: rises with guard, learner (in the agent's), agent and model."""
