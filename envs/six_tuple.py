"""Safety-Gymnasium's interface to our environments."""

from __future__ import annotations

from typing import Any, SupportsFloat

import gymnasium


class SixTuple(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Safety-Gymnasium's interface: step returns observation, reward, cost, terminated, truncated, info."""

    def step(self, action: Any) -> tuple[Any, SupportsFloat, float, bool, bool, dict[str, Any]]:  # type: ignore[override]
        """Carry out one decision with its cost as the third value."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, reward, float(info["cost"]), terminated, truncated, info
