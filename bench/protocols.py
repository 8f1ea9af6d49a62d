"""Protocols, and how protocol x methods x scenarios x seeds become `RunSpec`s."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from pydantic import ValidationError

from algorithms.method import Method
from algorithms.registry import (
    PAPER_METHODS,
    REFERENCE_DRIVERS,
    get_method,
)
from bench.errors import UsageError
from bench.settings import Settings
from bench.spec import RunSpec
from envs.plugins import UnavailableError
from envs.scenario import STEP_S, Scenario, UnknownNameError, get_scenario

ALL: Final = "all"
"""Stands for the six of the paper and the reference drivers; what is not installed is left out."""
SEEDS_MAX: Final = 10_000
"""Every seed is a run: a mistyped number must not fill the memory with them."""


@dataclass(frozen=True, slots=True)
class Protocol:
    """How much is done for each method and scenario.

    Attributes:
        name: What ``--protocol`` takes.
        steps: Simulation steps of 0.1 s for training.
        seeds: Number of replicates.
        eval_episodes: Held-out episodes for each seed.
    """

    name: str
    steps: int
    seeds: int
    eval_episodes: int


PROTOCOLS: Final = {
    protocol.name: protocol
    for protocol in (
        Protocol("smoke", 4_000, 1, 64),
        Protocol("quick", 100_000, 1, 1_000),
        Protocol("standard", 500_000, 5, 10_000),
        Protocol("paper", 1_000_000, 5, 10_000),
    )
}


@dataclass(frozen=True, slots=True)
class Request:
    """What ``bench run`` was asked for, as typed.

    Attributes:
        algo: Comma list of methods with parameters; ``all`` may be one of them.
        scenario: Comma list of scenarios with parameters.
        protocol: Name of a `Protocol`.
        seeds: A number of seeds or a comma list, or None for the protocol's.
        steps: Simulation steps, or None for the protocol's.
        eval_episodes: Held-out episodes, or None for the protocol's.
        settings: ``KEY=VALUE`` texts.
    """

    algo: str = "all"
    scenario: str = "a"
    protocol: str = "smoke"
    seeds: str | None = None
    steps: int | None = None
    eval_episodes: int | None = None
    settings: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class Expansion:
    """What a request comes to.

    Attributes:
        specs: The runs, in order of scenario, seed and method, so that early results compare methods.
        unavailable: Reason by method that was asked for and that cannot be used here.
    """

    specs: tuple[RunSpec, ...]
    unavailable: Mapping[str, str]


def split_names(text: str) -> list[str]:
    """Items of a comma list whose items may have parameters with commas.

    ``x:p=1,q=2,y`` is ``x:p=1,q=2`` and ``y``: an item with ``=`` but no ``:`` belongs to the one before.

    Raises:
        UsageError: A parameter has no name before it, or the list is empty.
    """
    items: list[str] = []
    for part in filter(None, (piece.strip() for piece in text.split(","))):
        if "=" not in part or ":" in part:
            items.append(part)
        elif items and ":" in items[-1]:
            items[-1] += f",{part}"
        else:
            raise UsageError(f"{part!r} in {text!r} is a parameter without a name before it: write NAME:{part}.")
    if not items:
        raise UsageError(f"{text!r} names nothing: give at least one name.")
    return list(dict.fromkeys(items))


def parse_seeds(text: str) -> list[int]:
    """Seeds of ``5`` (0 to 4), ``0,1,7`` or ``7,`` (only 7).

    Raises:
        UsageError: It is neither a positive number nor a list of different seeds, or more than `SEEDS_MAX`.
    """
    listed = "," in text
    try:
        numbers = [int(part) for part in text.split(",") if part.strip() or not listed]
    except ValueError:
        raise UsageError(f"--seeds {text}: give a number of seeds, or a list such as 0,1,2.") from None
    count = len(numbers) if listed else numbers[0]
    if count > SEEDS_MAX:
        raise UsageError(f"--seeds asks for {count} seeds: at most {SEEDS_MAX:,}; one alone is written as 7,")
    seeds = numbers if listed else list(range(count))
    if not seeds or min(seeds) < 0 or len(set(seeds)) < len(seeds):
        raise UsageError(f"--seeds {text}: give at least one seed, none negative, none twice.")
    return seeds


def find_methods(text: str) -> tuple[list[Method], dict[str, str]]:
    """Methods of a comma list, where ``all`` stands for the paper's and the reference drivers.

    Returns:
        The methods that can be used here, and the reasons of those that cannot.

    Raises:
        UsageError: A name or parameter is unknown, or none of the methods can be used here.
    """
    everything = (*PAPER_METHODS, *REFERENCE_DRIVERS)
    names = [name for item in split_names(text) for name in (everything if item == ALL else (item,))]
    methods: dict[str, Method] = {}
    unavailable: dict[str, str] = {}
    for name in names:
        try:
            method = get_method(name)
        except UnavailableError as error:
            unavailable[name] = str(error)
        except ValueError as error:
            raise UsageError(str(error)) from error
        else:
            methods.setdefault(method.spec, method)
    if not methods:
        raise UsageError("; ".join(f"Method {name!r} cannot be used here: {why}" for name, why in unavailable.items()))
    return list(methods.values()), unavailable


def find_scenarios(text: str, settings: Settings) -> list[Scenario]:
    """Scenarios of a comma list, with the ``scenario.KEY=VALUE`` settings in each.

    Raises:
        UsageError: A name, a parameter or its value cannot be used.
    """
    try:
        found = [get_scenario(settings.amend_scenario(name)) for name in split_names(text)]
    except (ValueError, UnavailableError) as error:
        raise UsageError(str(error)) from error
    return list({scenario.id: scenario for scenario in found}.values())


def expand(request: Request) -> Expansion:
    """The runs of a request.

    A method that does not train gets one run for each scenario: its seeds would be copies of each other.

    Raises:
        UsageError: Something in the request cannot be used.
    """
    if request.protocol not in PROTOCOLS:
        raise UsageError(str(UnknownNameError("protocol", request.protocol, list(PROTOCOLS))))
    protocol = PROTOCOLS[request.protocol]
    methods, unavailable = find_methods(request.algo)
    settings = Settings.parse(request.settings, {method.name: method.setting_names for method in methods})
    scenarios = find_scenarios(request.scenario, settings)
    seeds = parse_seeds(request.seeds) if request.seeds is not None else list(range(protocol.seeds))
    steps = protocol.steps if request.steps is None else request.steps
    episodes = protocol.eval_episodes if request.eval_episodes is None else request.eval_episodes
    specs = [
        _spec(method, scenario, seed if method.trains else 0, steps if method.trains else 0, episodes, settings)
        for scenario in scenarios
        for seed in seeds
        for method in methods
        if method.trains or seed == seeds[0]
    ]
    return Expansion(tuple(specs), unavailable)


def _spec(method: Method, scenario: Scenario, seed: int, steps: int, episodes: int, settings: Settings) -> RunSpec:
    if method.trains and (steps <= 0 or steps % scenario.substeps):
        nearest = max(1, round(steps / scenario.substeps)) * scenario.substeps
        raise UsageError(
            f"--steps {steps} on {scenario.id}: must be a positive multiple of {scenario.substeps}, "
            f"because one decision takes {scenario.substeps} steps of {STEP_S} s; nearest: {nearest}."
        )
    chosen = settings.methods.get(method.name, {})
    try:
        method.check_settings(chosen)
        return RunSpec(
            method=method.spec,
            method_version=method.version,
            scenario=scenario.name,
            scenario_version=scenario.version,
            seed=seed,
            steps=steps,
            eval_episodes=episodes,
            cost_limit=settings.cost_limit,
            cost_signal=settings.cost_signal,
            settings=chosen,
        )
    except ValidationError as error:
        reasons = ((".".join(map(str, e["loc"])), e["msg"].removeprefix("Value error, ")) for e in error.errors())
        raise UsageError("; ".join(f"{name}: {reason}" for name, reason in reasons)) from error
    except ValueError as error:
        raise UsageError(f"--set for {method.name}: {error}") from error
