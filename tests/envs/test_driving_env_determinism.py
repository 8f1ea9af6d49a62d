"""Determinism: the same seed gives the same bytes, whatever else runs, and episodes replay by their number."""

from typing import Any

import numpy as np
import pytest
from gymnasium.vector import VectorEnv

from envs.driving_env import DrivingVectorEnv
from envs.layout import held_out_source
from envs.scenario import get_scenario
from envs.single_env import DrivingEnv
from envs.world import EPISODE
from tests.envs.roll_outs import FULL_THROTTLE, actions, source
from tests.envs.small_worlds import driving_env

kernels = pytest.mark.kernels


def roll_out(env: VectorEnv[Any, Any, Any], steps: int, seed: int = 6) -> list[bytes]:
    rng = np.random.default_rng(seed)
    found = [env.reset(seed=2)[0].tobytes()]
    for _ in range(steps):
        result = env.step(actions(rng, env.num_envs))
        found += [part.tobytes() for part in result[:4]]
    return found


@pytest.mark.parametrize("name", ["b", "a-dense-mobil"])
def test_two_interleaved_environments_give_the_same_bytes(name: str) -> None:
    one, other = (DrivingVectorEnv(name, 5) for _ in range(2))
    rngs = [np.random.default_rng(6) for _ in range(2)]
    assert one.reset(seed=2)[0].tobytes() == other.reset(seed=2)[0].tobytes()
    for _ in range(150):
        mine, theirs = (env.step(actions(rng, 5)) for env, rng in zip((one, other), rngs, strict=True))
        assert [p.tobytes() for p in mine[:4]] == [p.tobytes() for p in theirs[:4]]
    assert one.finished_episodes().tobytes() == other.finished_episodes().tobytes()
    assert one.episodes_done > 0
    assert roll_out(one, 20) == roll_out(other, 20)


def test_another_seed_gives_other_episodes() -> None:
    env = DrivingVectorEnv("a", 2)
    assert env.reset(seed=1)[0].tobytes() != env.reset(seed=2)[0].tobytes()


@pytest.mark.parametrize("name", ["b", "a-dense-mobil"])
def test_two_threads_give_the_same_bytes_as_one(name: str) -> None:
    one, two = (DrivingVectorEnv(name, 17, threads=threads) for threads in (1, 2))
    assert roll_out(one, 120) == roll_out(two, 120)
    assert one.finished_episodes().tobytes() == two.finished_episodes().tobytes()


@pytest.mark.parametrize("name", ["b", "a-dense-mobil"])
def test_a_world_does_not_depend_on_how_many_others_there_are(name: str) -> None:
    rng = np.random.default_rng(8)
    plans = [actions(rng, 180) for _ in range(12)]  # what each episode's driver does, by its number

    def drive(worlds: int) -> dict[int, bytes]:
        env = DrivingVectorEnv(name, worlds, source=source(name, 12))
        observations, _ = env.reset()
        seen: dict[int, list[bytes]] = {k: [] for k in range(12)}
        while env.active.any():
            numbers, steps = env.world.episode["episode"], env.world.episode["steps"] // 5
            for i in np.flatnonzero(env.active):
                seen[int(numbers[i])].append(observations[i].tobytes())
            held = [plans[number][min(step, 179)] for number, step in zip(numbers, steps, strict=True)]
            observations = env.step(np.array(held))[0]
        return {k: b"".join(v) for k, v in seen.items()}

    alone = drive(1)
    assert alone == drive(5) == drive(12)
    assert len(set(alone.values())) == 12


@pytest.mark.parametrize("number", [0, 7, 1023, 1024])
def test_episode_k_of_a_source_replays_identically(number: int) -> None:
    everything = DrivingVectorEnv("b", 1, source=source("b", start=max(0, number - 2)))
    only = DrivingVectorEnv("b", 1, source=source("b", number + 1, start=number))
    only.reset()
    everything.reset()
    while everything.world.episode["episode"][0] != number:
        everything.step(FULL_THROTTLE[None])
    rng = np.random.default_rng(0)
    while only.active.any():
        drawn = actions(rng, 1)
        mine, theirs = only.step(drawn), everything.step(drawn)
        if "final_obs" in mine[4]:
            assert mine[4]["final_obs"].tobytes() == theirs[4]["final_obs"].tobytes()
            names = [name for name in EPISODE.names or () if name != "end_step"]
            assert mine[4]["finished"][names].tolist() == theirs[4]["finished"][names].tolist()
        else:
            assert mine[0].tobytes() == theirs[0].tobytes()
        assert mine[1].tobytes() == theirs[1].tobytes()


@kernels
def test_a_seed_starts_the_source_that_was_given_from_its_beginning_and_replaces_it_by_no_other() -> None:
    env = driving_env("a", 2, source=held_out_source(get_scenario("a"), 4))
    first, _ = env.reset()
    env.reset()
    again, _ = env.reset(seed=123)
    assert (first == again).all()
    assert env.world.episode["episode"].tolist() == [0, 1]


@kernels
def test_without_a_seed_reset_goes_on_in_the_stream() -> None:
    env = driving_env("a", 2)
    env.reset(seed=4)
    env.reset()
    assert env.world.episode["episode"].tolist() == [2, 3]


@kernels
def test_a_numpy_integer_is_the_seed_that_it_equals() -> None:
    expected = driving_env("a", 2).reset(seed=7)[0]
    assert (driving_env("a", 2).reset(seed=np.int64(7))[0] == expected).all()  # type: ignore[arg-type]
    pair = driving_env("a", 2).reset(seed=[3, 4])[0]
    assert (driving_env("a", 2).reset(seed=[np.int64(3), np.uint8(4)])[0] == pair).all()  # type: ignore[list-item]
    assert (DrivingEnv("a").reset(seed=np.int64(7))[0] == DrivingEnv("a").reset(seed=7)[0]).all()  # type: ignore[arg-type]


@kernels
def test_no_seed_for_any_world_is_no_seed() -> None:
    one, other = (driving_env("a", 2).reset(seed=[None, None])[0] for _ in range(2))
    assert (one != other).any()
    env = driving_env("a", 2)
    env.reset(seed=4)
    env.reset(seed=[None, None])
    assert env.world.episode["episode"].tolist() == [2, 3]


@kernels
@pytest.mark.parametrize(
    ("seed", "error", "message"),
    [
        ([1], ValueError, "1 seeds for 2 worlds"),
        ([1, None], ValueError, "all of them need a seed, or none"),
        (-1, ValueError, "seed = -1: must not be negative"),
        ([1, 2.5], TypeError, "must be an integer"),
    ],
)
def test_an_unusable_seed_is_refused(seed: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        driving_env("a", 2).reset(seed=seed)
