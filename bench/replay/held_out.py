"""Held-out episodes of a record, driven again and compared with what was recorded."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pyarrow as pa
import torch

from algorithms.method import Budget, Policy, Task
from algorithms.registry import get_method
from bench import schema, store
from bench.errors import BenchError, RecordError, UsageError
from bench.evaluate import WORLDS, begin_evaluation, evaluation_env
from bench.records import Record
from bench.replay.shield_watch import GuardView, watch
from envs.driving_env import CostSignal, DrivingVectorEnv
from envs.layout import EpisodeSource, held_out_source
from envs.plugins import UnavailableError
from envs.trace import EpisodeTrace, record_rows, seat

UNCHECKED: Final = ("world", "end_step")
"""Columns that say where and when an episode ran, not what happened in it."""
ROUNDING: Final = 1e-4
"""Relative and absolute difference of a figure that another processor's rounding may explain."""
NOTHING: Final = 1e-12
"""Absolute difference below which two figures are the same: a lateral error of 1e-20 m is none."""


class ReplayDiffersError(BenchError):
    """An episode does not come out as it was recorded: it is not shown."""


@dataclass(frozen=True, slots=True)
class Replay:
    """An episode that was driven again.

    Attributes:
        title: Who drove, for people.
        trace: Every 0.1 s of it.
        guard: What the guard knew, or None without a guard that can say so.
        exact: Whether every recorded figure came out the same; else all agree but for rounding.
    """

    title: str
    trace: EpisodeTrace
    guard: GuardView | None
    exact: bool = True


def replay(record: Record, numbers: Sequence[int]) -> list[Replay]:
    """Drive held-out episodes of a record again, and check every recorded figure of each.

    On another processor than the record's the products of a network round otherwise: a replay whose counts are the
    same and whose other figures agree within `ROUNDING` is given, marked as not exact.

    First only the wanted episodes are driven, in as many worlds as the evaluation had: a policy that looks at each
    world by itself gives the same bits. Where one differs, the policy carries something from episode to
    episode, such as a generator, and the evaluation is driven from its start up to the last of them.

    Args:
        record: Whose policy drives.
        numbers: Of the episodes; the order of the result.

    Raises:
        UsageError: The record holds no policy, or one that this version of the project cannot drive.
        RecordError: A file is not what was sealed.
        ReplayDiffersError: An episode comes out otherwise than it was recorded, by more than rounding.
    """
    torch.set_num_threads(1)  # as in a run: rounding depends on it
    recorded = record.eval_episodes()
    wanted = list(dict.fromkeys(numbers))
    found: dict[int, Replay] = {}
    for start in range(0, len(wanted), WORLDS):
        some = wanted[start : start + WORLDS]
        found |= _drive(record, {number: row for row, number in enumerate(some)}, whole=False)
    differing = [number for number in wanted if differences(found[number].trace, recorded, ROUNDING)]
    if differing:
        worlds = schema.column(recorded, "world")
        found |= _drive(record, {number: int(worlds[number]) for number in differing}, whole=True)
    for number in differing:
        _require_same(record, found[number].trace, recorded)
    return [
        dataclasses.replace(found[number], exact=not differences(found[number].trace, recorded)) for number in numbers
    ]


def _drive(record: Record, seats: Mapping[int, int], whole: bool) -> dict[int, Replay]:
    policy, task = load_policy(record)
    source = held_out_source(task.scenario, record.spec.eval_episodes)
    watched = watch(policy.shield, seats)
    begun: EpisodeSource = source if whole else seat(source, list(seats), WORLDS)
    env = evaluation_env(policy, WORLDS, begun, task.cost_signal, watched)
    begin_evaluation(policy, WORLDS, task.scenario)
    traces = _record(env, source, seats, policy)
    return {
        trace.number: Replay(record.spec.label, trace, watched.view(trace.number) if watched else None)
        for trace in traces
    }


def _record(
    env: DrivingVectorEnv, source: EpisodeSource, seats: Mapping[int, int], policy: Policy
) -> list[EpisodeTrace]:
    try:
        return record_rows(env, source, seats, policy.act)
    except ValueError as error:  # an episode ended elsewhere than it was recorded
        raise ReplayDiffersError(str(error)) from error


def load_policy(record: Record) -> tuple[Policy, Task]:
    """The policy of a record, and the task that it was trained on.

    The method may be of another version by now: whether it still drives as recorded is for the replay to check.

    Raises:
        UsageError: It is not there, or its method or scenario is not available here.
        RecordError: A file of it is not what was sealed.
    """
    spec = record.spec
    folder = record.path / store.POLICY_FOLDER
    sealed = [name for name in record.seals if name.startswith(f"{store.POLICY_FOLDER}/")]
    if not folder.is_dir():
        raise UsageError(
            f"{record.path.name} holds no policy (to save room, only seed 0 of a method may keep its own): "
            f"choose a run whose folder has {store.POLICY_FOLDER}/, or run {spec.label} again, with --results "
            "set to another folder."
        )
    for name in sealed:
        record.sealed(name)
    try:
        method = get_method(spec.method)
        scenario = spec.resolve_scenario()
    except (UnavailableError, ValueError) as error:
        raise UsageError(f"{record.path.name}: {error}") from error
    signal = CostSignal[spec.cost_signal.upper()]
    task = Task(scenario, spec.seed, Budget(spec.steps), spec.cost_limit, signal, dict(spec.settings))
    try:
        return method.load_policy(folder, task), task
    except (ValueError, OSError) as error:
        raise RecordError(f"{record.path.name}: {error}") from error


def differences(trace: EpisodeTrace, recorded: pa.Table, tolerance: float = 0.0) -> list[str]:
    """Each recorded figure that a trace does not give, as ``name: recorded, now``.

    Args:
        trace: A held-out episode.
        recorded: Held-out episodes, in order of number.
        tolerance: Relative and absolute, of figures that are no counts; at least `NOTHING`.
    """
    own = schema.episodes_table(trace.episode[-1:])
    differing = []
    for name in own.column_names:
        was, now = schema.column(recorded, name)[trace.number], schema.column(own, name)[0]
        allowed = 0.0
        if np.issubdtype(was.dtype, np.floating):
            # Records of the first tables hold more digits.
            was, allowed = schema.rounded(np.array([was]))[0], tolerance
        if name not in UNCHECKED and not np.isclose(now, was, rtol=allowed, atol=max(allowed, NOTHING), equal_nan=True):
            differing.append(f"{name}: {was}, now {now}")
    return differing


def _require_same(record: Record, trace: EpisodeTrace, recorded: pa.Table) -> None:
    differing = differences(trace, recorded, ROUNDING)
    if differing:
        provenance = record.details.get("provenance", {})
        packages = provenance.get("packages", {})
        raise ReplayDiffersError(
            f"{record.path.name}, episode {trace.number}, comes out otherwise than it was recorded "
            f"({'; '.join(differing)}). It is not shown. The record is of version {record.spec.method_version} of the "
            f"method, commit "
            f"{str(provenance.get('git', {}).get('commit'))[:12]} with torch {packages.get('torch')} and numpy "
            f"{packages.get('numpy')} on {provenance.get('cpu')}: other code, another version or another processor "
            "may round otherwise."
        )
