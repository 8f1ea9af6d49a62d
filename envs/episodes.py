"""Episodes of a vector environment: which one a world begins next, and the records of those that have ended."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from envs import batch
from envs.layout import CHUNK, EpisodeSource
from envs.scenario import Scenario
from envs.world import BoolArray, Ending, Records, World, no_episodes


def stream_seed(seed: int | Sequence[int | None] | None, worlds: int) -> list[int] | None:
    """What names one stream for all worlds; None where no seed is given, to no world.

    Args:
        seed: An integer, numpy's included, or one for each world, as gymnasium's vector environments take it.
        worlds: Their number.

    Raises:
        TypeError: A seed is no integer.
        ValueError: Seeds are another number than the worlds, negative, or only some of them None.
    """
    if seed is None:
        return None
    if isinstance(seed, int | np.integer):
        numbers: list[int | None] = [seed]
    else:
        numbers = list(seed)
        if len(numbers) != worlds:
            raise ValueError(f"seed = {seed}: {len(numbers)} seeds for {worlds} worlds.")
        if all(number is None for number in numbers):
            return None
    found: list[int] = []
    for number in numbers:
        if number is None:
            raise ValueError(f"seed = {seed}: worlds draw from one stream, so that all of them need a seed, or none.")
        if not isinstance(number, int | np.integer):
            raise TypeError(f"seed = {seed!r}: must be an integer, or a list of one for each world.")
        if number < 0:
            raise ValueError(f"seed = {seed}: must not be negative.")
        found.append(int(number))
    return found


def masked_worlds(mask: Any, worlds: int, autoreset: bool) -> npt.NDArray[np.int64]:
    """Indices that gymnasium's ``reset_mask`` names.

    Raises:
        TypeError: The mask is no array of bool.
        ValueError: It has another shape or names no world, or worlds reset themselves.
    """
    if not (isinstance(mask, np.ndarray) and mask.dtype == np.bool_):
        raise TypeError(f"options['reset_mask'] = {mask!r}: must be a numpy array of bool.")
    if autoreset:
        raise ValueError("options['reset_mask'] needs autoreset=False: otherwise finished worlds reset themselves.")
    if mask.shape != (worlds,) or not mask.any():
        raise ValueError(f"options['reset_mask'] = {mask}: must have shape ({worlds},) and name at least one world.")
    return np.flatnonzero(mask)


class EpisodeStream:
    """Episodes of a source, begun one after another.

    Args:
        scenario: What the stream of a seed draws.
        source: Numbered initial states, or None for an endless stream from the seed of `restart`.

    Attributes:
        next_episode: Number of the episode that begins next.
    """

    def __init__(self, scenario: Scenario, source: EpisodeSource | None) -> None:
        self.next_episode = 0
        self._scenario = scenario
        self._source = source
        self._source_given = source is not None
        self._chunk: tuple[int, World] | None = None

    def restart(self, seed: list[int] | None) -> None:
        """Start the stream of a seed, or the given source, anew; without a seed go on, if there is a source yet."""
        if seed is not None or self._source is None:
            if self._source is None or not self._source_given:
                self._source = EpisodeSource(self._scenario, np.random.SeedSequence(seed))
            self._chunk = None
            self.next_episode = 0
        assert self._source is not None
        self.next_episode = max(self.next_episode, self._source.start)

    def go_on_from(self, episode: int) -> None:
        """Make the episode of this number the next to begin."""
        self.next_episode = episode
        self._chunk = None

    def begin(
        self, worlds: npt.NDArray[np.int64], now: World, active: BoolArray, interventions: npt.NDArray[np.int64]
    ) -> None:
        """Load the next episodes into some worlds, in order of world; where the source has ended, they stay inactive.

        Args:
            worlds: Indices of the worlds to load.
            now: N worlds, written.
            active: Which worlds take part, shape (N,), written.
            interventions: Of the episode so far, shape (N,), written.
        """
        assert self._source is not None
        if self._source.stop is not None:
            left = max(self._source.stop - self.next_episode, 0)
            now.episode["ending"][worlds[left:]] = Ending.TIME_OUT
            worlds = worlds[:left]
        while len(worlds):
            index, row = divmod(self.next_episode, CHUNK)
            if self._chunk is None or self._chunk[0] != index:
                self._chunk = (index, self._source.chunk(index))
            start, some = self._chunk[1], worlds[: CHUNK - row]
            batch.load_episodes(
                now.ego, now.vehicles, now.pedestrians, now.episode, active, interventions, some,
                start.ego, start.vehicles, start.pedestrians, start.episode, row,
            )  # fmt: skip
            self.next_episode += len(some)
            worlds = worlds[len(some) :]


class EpisodeLog:
    """`EPISODE` records of the episodes that have ended, in order of completion."""

    def __init__(self) -> None:
        self._finished: list[Records] = []

    def __len__(self) -> int:
        return sum(map(len, self._finished))

    def add(self, records: Records) -> None:
        """Keep the records of episodes that ended together."""
        self._finished.append(records)

    def replace(self, records: Records) -> None:
        """Keep these records only."""
        self._finished = [records]

    def all(self) -> Records:
        """All of them."""
        return np.concatenate([no_episodes(), *self._finished])

    def last(self, count: int) -> Records:
        """The last so many."""
        batches: list[Records] = []
        for records in reversed(self._finished):
            batches.insert(0, records)
            if sum(map(len, batches)) >= count:
                break
        return np.concatenate([no_episodes(), *batches])[-count:]
