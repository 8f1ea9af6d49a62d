"""The guard as a filter: usable adjustment times, actions passed through, many worlds as each alone."""

import dataclasses
import math

import numpy as np
import pytest

from algorithms.guard_demand import require_horizon
from algorithms.guard_options import GuardOptions, Switches
from algorithms.safety_guard import SafetyGuard
from envs.world import WAITING, World, empty_world
from tests.algorithms.guard_scenes import SWITCHES, guarded, limits, scene

pytestmark = pytest.mark.kernels


@pytest.mark.parametrize("tc", [0.0, -1.0, math.nan, math.inf, -math.inf])
def test_an_unusable_adjustment_time_is_named(tc):
    with pytest.raises(ValueError, match="T_c"):
        require_horizon(tc)
    with pytest.raises(ValueError, match="T_c"):
        SafetyGuard(tc)


@pytest.mark.parametrize("tc", [0.0, -1.0, math.nan, math.inf])
def test_an_unusable_adjustment_time_of_one_world_is_named_with_the_world(tc):
    class Adjustable(SafetyGuard):
        def horizons(self, world):
            return np.array([3.0, tc])

    with pytest.raises(ValueError, match=r"T_c .* in world 1"):
        Adjustable().filter(empty_world(2, 1, 0), np.zeros(2), np.zeros(2))


class Asking(SafetyGuard):
    """Asks for what it is told to."""

    def __init__(self, horizons, shares, importance):
        super().__init__()
        self.asked = np.array(horizons), np.array(shares), np.array(importance)

    def horizons(self, world):
        return self.asked[0]

    def shares(self, world):
        return self.asked[1]

    def importance(self, world):
        return self.asked[2]


@pytest.mark.parametrize("share", [-0.01, 1.01, math.nan, math.inf, -math.inf])
def test_an_unusable_share_of_one_world_is_named_with_the_world(share):
    # 20 m behind a standing car a share of NaN demanded nothing but the reserve.
    world = two_worlds_before_a_standing_car()
    with pytest.raises(ValueError, match=rf"^share = {share} in world 1: must be between 0 and 1\.$"):
        Asking([3.0, 3.0], [1.0, share], np.zeros((2, 1))).filter(world, np.zeros(2), np.ones(2))
    for usable in (0.0, 1.0):
        Asking([3.0, 3.0], [1.0, usable], np.zeros((2, 1))).filter(world, np.zeros(2), np.ones(2))


@pytest.mark.parametrize("rank", [math.nan, math.inf, -math.inf])
def test_an_unusable_importance_is_named_with_body_and_world(rank):
    # NaN beats no other key: the one car ahead did not bind at all.
    world = two_worlds_before_a_standing_car()
    with pytest.raises(ValueError, match=rf"^importance = {rank} of body 0 in world 1: must be finite\.$"):
        Asking([3.0, 3.0], [1.0, 1.0], [[0.5], [rank]]).filter(world, np.zeros(2), np.ones(2))


@pytest.mark.parametrize(
    "shapes", [((0,), (2,), (2, 1)), ((2,), (3,), (2, 1)), ((2,), (2,), (2, 0)), ((2,), (2,), (1,))]
)
def test_a_demand_for_other_worlds_is_refused(shapes):
    horizons, shares, importance = (np.ones(shape) for shape in shapes)
    with pytest.raises(ValueError, match=r"2 worlds of 1 bodies need .* call observe"):
        Asking(horizons, shares, importance).filter(two_worlds_before_a_standing_car(), np.zeros(2), np.ones(2))


def two_worlds_before_a_standing_car():
    one = scene([(20.0, 0.0, 0.0)])
    return World(*(np.concatenate([part, part]) for part in (one.ego, one.vehicles, one.pedestrians, one.episode)))


@pytest.mark.parametrize("bodies", [(0, 0), (3, 0), (0, 2), (3, 2)])
def test_an_empty_world_passes_the_action_through(bodies):
    world = empty_world(1, *bodies)
    world.pedestrians["state"] = WAITING
    assert guarded(world, target=3.5, acceleration=1.7) == (3.5, 1.7, False)
    assert tuple(limits(world)) == (math.inf, -math.inf)


def test_the_planner_gets_three_seconds_or_a_longer_adjustment_time():
    for tc, expected in ((0.5, 3.0), (3.0, 3.0), (7.0, 7.0)):
        assert SafetyGuard(tc).filter(empty_world(2, 1, 0), np.zeros(2), np.zeros(2))[3] == pytest.approx(expected)


def test_an_acceleration_beyond_what_the_ego_has_is_clipped_without_a_flag():
    assert guarded(scene(), acceleration=2.5) == (0.0, 2.0, False)
    assert guarded(scene(), acceleration=-2.5) == (0.0, -2.0, False)


def test_one_guard_follows_worlds_of_changing_number_and_size():
    guard = SafetyGuard(3.0)
    for n, cars in ((2, 1), (5, 1), (5, 4), (1, 0)):
        assert len(guard.filter(empty_world(n, cars, 2), np.zeros(n), np.zeros(n))[0]) == n


def random_worlds(n, seed=0):
    rng = np.random.default_rng(seed)
    world = empty_world(n, 4, 2)
    for name, low, high in (("d", -4.0, 4.0), ("speed", 0.0, 13.89), ("heading", -0.3, 0.3), ("target_d", -4.0, 4.0)):
        world.ego[name] = rng.uniform(low, high, n)
    world.ego["reference_d"] = world.ego["d"]
    world.ego["reference_speed"] = rng.uniform(-2.0, 2.0, n)
    world.vehicles["present"] = rng.random((n, 4)) < 0.8
    world.vehicles["s"] = rng.uniform(-60.0, 90.0, (n, 4))
    world.vehicles["d"] = rng.choice([-3.5, 0.0, 3.5], (n, 4))
    world.vehicles["speed"] = rng.uniform(0.0, 13.0, (n, 4))
    world.pedestrians["state"] = rng.integers(0, 3, (n, 2))
    world.pedestrians["s"] = rng.uniform(-5.0, 90.0, (n, 2))
    world.pedestrians["d"] = rng.uniform(-5.0, 5.0, (n, 2))
    world.pedestrians["lateral_speed"] = rng.uniform(-1.8, 1.8, (n, 2))
    return world, rng.uniform(-4.25, 4.25, n), rng.uniform(-2.0, 2.0, n)


def one_world(world, i):
    return World(*(part[i : i + 1] for part in (world.ego, world.vehicles, world.pedestrians, world.episode)))


def test_many_worlds_are_guarded_as_each_would_be_alone():
    world, targets, accelerations = random_worlds(60)
    together = SafetyGuard(3.0).filter(world, targets, accelerations)
    alone = SafetyGuard(3.0)
    assert 10 < together[2].sum() < 60
    for i in range(60):
        single = alone.filter(one_world(world, i), targets[i : i + 1], accelerations[i : i + 1])
        assert [part[0] for part in single] == [part[i] for part in together]


def test_the_filter_leaves_its_arguments_and_earlier_answers_alone():
    world, targets, accelerations = random_worlds(30)
    before = [part.tobytes() for part in (world.ego, world.vehicles, world.pedestrians, world.episode)]
    wishes = targets.tobytes(), accelerations.tobytes()
    guard = SafetyGuard(3.0)
    answer = guard.filter(world, targets, accelerations)
    kept = [part.copy() for part in answer]
    guard.filter(world, -targets, -accelerations)
    assert [p.tobytes() for p in (world.ego, world.vehicles, world.pedestrians, world.episode)] == before
    assert (targets.tobytes(), accelerations.tobytes()) == wishes
    for part, copy in zip(answer, kept, strict=True):
        assert np.array_equal(part, copy)


def test_limits_of_the_last_call_are_kept_for_every_world():
    world, targets, accelerations = random_worlds(7)
    guard = SafetyGuard(3.0)
    guard.filter(world, targets, accelerations)
    assert guard.limits.shape == (7, 2)


def test_options_reach_the_kernel_in_order():
    names = [field.name.removeprefix("literal_") for field in dataclasses.fields(GuardOptions)]
    printed = {"selection": "least_binding", "longitudinal": "printed_longitudinal"}
    assert list(Switches._fields) == [printed.get(name, name) for name in names]
    for field in dataclasses.fields(GuardOptions):
        flipped = dataclasses.replace(GuardOptions(), **{field.name: not field.default})
        assert sum(a != b for a, b in zip(dataclasses.astuple(flipped), SWITCHES, strict=True)) == 1
