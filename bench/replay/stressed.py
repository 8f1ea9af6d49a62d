"""Episodes of a stress test by name: ``stress:SCENARIO:tc=3.0:driver=random``, driven again bit for bit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from algorithms.guard_options import GuardOptions
from algorithms.risk_guard import RiskGuard
from algorithms.risk_training import risk_model
from algorithms.safety_guard import SafetyGuard
from bench.errors import UsageError
from bench.replay.held_out import Replay
from bench.replay.shield_watch import ShieldWatch
from bench.stress import OPTION_NAMES, RANDOM, parse_options, replay_stress
from bench.stress_result import DD_RQ
from envs.scenario import Scenario, UnknownNameError, get_scenario

PREFIX: Final = "stress:"
EXAMPLE: Final = "stress:a:tc=3.0:driver=random"


@dataclass(frozen=True, slots=True)
class StressName:
    """A stress test, as ``bench stress guard`` runs it; the same keys, the same defaults.

    Attributes:
        scenario: Where.
        tc: T_c in seconds as a text, or ``dd-rq``.
        driver: Who proposes the actions.
        seed: Names the stream of episodes and of the driver's draws.
        agent_steps: ``dd-rq``: budget of the driving agent behind its model.
        options: Readings of Alg. 2.
    """

    scenario: Scenario
    tc: str = "3.0"
    driver: str = RANDOM
    seed: int = 0
    agent_steps: int = 500_000
    options: GuardOptions = field(default_factory=GuardOptions)


def parse_name(text: str) -> StressName:
    """The stress test of a name such as ``stress:b:tc=1.0:driver=cruise:seed=3``.

    Parts after the scenario's name and its own parameters are keys of `StressName`, in any order, or guard options
    such as ``reserve=false``.

    Raises:
        UsageError: A key or the scenario is unknown, or a value unusable.
    """
    parts = text.removeprefix(PREFIX).split(":")
    keys = ("tc", "driver", "seed", "agent_steps")
    own = [part for part in parts if part.partition("=")[0] in keys]
    switches = [part for part in parts if part.partition("=")[0] in OPTION_NAMES]
    values = {key: value for key, _, value in (part.partition("=") for part in own)}
    try:
        scenario = get_scenario(":".join(part for part in parts if part not in own + switches))
        options = parse_options(switches)
        if not all(values.values()):
            raise ValueError("A key has no value.")
        if values.get("tc", DD_RQ) != DD_RQ:
            float(values["tc"])
        numbers = {key: int(values.pop(key)) for key in ("seed", "agent_steps") if key in values}
    except (ValueError, UnknownNameError) as error:
        raise UsageError(f"{text}: {error} Expected a name such as {EXAMPLE}.") from error
    return StressName(scenario, options=options, **values, **numbers)  # type: ignore[arg-type]  # the rest are texts


def replay_named(name: StressName, episodes: Sequence[int], cache: Path) -> list[Replay]:
    """Drive episodes of a stress test again; their draws depend on nothing but their number.

    Raises:
        UsageError: The driver is unknown, or T_c out of range.
    """
    try:
        model = risk_model(name.scenario, name.agent_steps, cache) if name.tc == DD_RQ else None
        shields = (
            RiskGuard(model, options=name.options) if model else SafetyGuard(float(name.tc), name.options)
            for _ in episodes
        )
        return [_replay(name, episode, shield) for episode, shield in zip(episodes, shields, strict=True)]
    except ValueError as error:
        raise UsageError(str(error)) from error


def _replay(name: StressName, episode: int, guard: SafetyGuard) -> Replay:
    watched = ShieldWatch(guard, {episode: 0})
    trace = replay_stress(
        name.scenario,
        DD_RQ if name.tc == DD_RQ else float(name.tc),
        name.driver,
        episode,
        seed=name.seed,
        shield_factory=lambda _: watched,
    )
    title = f"stress on {name.scenario.id}: {name.driver} behind the guard, T_c {name.tc}, seed {name.seed}"
    return Replay(title, trace, watched.view(episode))
