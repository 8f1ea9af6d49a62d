"""SAC behind the guard of Responsibility-Sensitive Safety."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from algorithms.method import Method, Policy, Task
from algorithms.sac import SETTING_NAMES, SACSettings
from algorithms.versions import LEARNER_VERSION, RSS_VERSION


class RSSGuarded(Method):
    """SAC behind the RSS guard: what a published rule without learning makes of the same learner."""

    version = RSS_VERSION + LEARNER_VERSION
    setting_names = SETTING_NAMES

    def check_settings(self, settings: Mapping[str, str]) -> None:
        """Refuse what the learner cannot use."""
        SACSettings.from_settings(settings)

    def train(self, task: Task) -> Policy:
        """Train with the guard between policy and world; r_risk is paid where it intervenes."""
        from algorithms.rss_guard import RSSGuard
        from algorithms.sac_training import train_sac

        return train_sac(task, RSSGuard())

    def load_policy(self, folder: Path, task: Task) -> Policy:
        """The saved actor behind the guard."""
        from algorithms.networks import NetworkPolicy
        from algorithms.rss_guard import RSSGuard

        return NetworkPolicy.load(folder, RSSGuard())
