"""The constrained MDP: scenarios, the compiled engine and its gymnasium faces."""

import gymnasium

from envs.scenario import GYMNASIUM_IDS

for _name, _id in GYMNASIUM_IDS.items():
    if _id not in gymnasium.registry:
        gymnasium.register(
            id=_id,
            entry_point="envs.single_env:DrivingEnv",
            vector_entry_point="envs.driving_env:DrivingVectorEnv",
            kwargs={"scenario": _name},
        )
