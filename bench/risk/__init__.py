"""``bench risk report``: what the risk models say of scenes, against what then happens."""
