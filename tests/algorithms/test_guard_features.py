"""The limits that an aware policy sees are those that its guard will apply."""

import math

import numpy as np
import pytest
from scipy.special import logit

from algorithms.corridor import reach
from algorithms.guard_features import FEATURES, GuardFeatures, observed_world, scaled
from algorithms.guard_options import GuardOptions
from algorithms.method import Budget, Task
from algorithms.networks import PolicyFileError
from algorithms.registry import get_method
from algorithms.risk_guard import ShareGuard
from algorithms.risk_model import RiskOutput
from algorithms.safety_guard import SafetyGuard
from algorithms.sb3_env import StableBaselinesEnv
from envs.driving_env import DrivingVectorEnv
from envs.geometry import lane_centre, nearest_lane
from envs.scenario import get_scenario
from envs.world import CROSSING
from tests.algorithms.guard_scenes import limits, scene

WORLDS = 64


class Model:
    """A model of contact that sees more danger the faster the ego is."""

    description = {"value_mean": 0.3, "value_quantiles": [0.1, 0.9]}  # noqa: RUF012
    asked = 0

    def __call__(self, observations):
        self.asked += 1
        importance = np.zeros((len(observations), 8))
        importance[:, 1] = 1.0
        return RiskOutput(logit(0.1 + 0.8 * observations[:, 2].astype(float)), importance)


GUARDS = {
    "T_c 1 s": lambda: SafetyGuard(1.0),
    "T_c 7 s": lambda: SafetyGuard(7.0),
    "share 0.2": lambda: SafetyGuard(3.0, share=0.2),
    "risk": lambda: ShareGuard(Model()),
    "shuffled": lambda: ShareGuard(Model(), share="shuffled"),
}


def comparable(env):
    """Worlds whose planner does what the body does, and whose bodies are all in sight: features cannot know more."""
    ego, vehicles = env.world.ego, env.world.vehicles
    seen = (vehicles["present"] == 0) | (np.abs(vehicles["s"] - ego["s"][:, None]) <= 200.0)
    return (
        seen.all(axis=1)
        & (np.abs(ego["reference_d"] - ego["d"]) < 1e-6)
        & (np.abs(ego["reference_speed"]) + np.abs(ego["reference_acceleration"]) < 1e-6)
        & (np.abs(ego["heading"]) < 1e-6)
    )


@pytest.mark.parametrize("name", GUARDS)
@pytest.mark.parametrize("scenario", ["a", "b", "a-mobil"])
def test_features_are_the_limits_that_the_guard_applies(scenario, name):
    guard = GUARDS[name]()
    guard.begin(np.random.SeedSequence(1))
    env = DrivingVectorEnv(scenario, WORLDS, shield=guard)
    observations, _ = env.reset(seed=4)
    features, rng = GuardFeatures(guard), np.random.default_rng(0)
    compared = np.zeros(3, int)
    bound = 0
    for _ in range(60):
        shown = features(observations)[:, 47:].reshape(WORLDS, 3, 2)
        guard.observe(observations)
        own = np.array([nearest_lane(d) for d in env.world.ego["d"]])
        for k in range(3):
            lane = own + k - 1
            there = (lane >= 0) & (lane <= 2) & comparable(env)
            targets = np.array([lane_centre(x) for x in np.clip(lane, 0, 2)])
            executed = guard.filter(env.world, targets, np.zeros(WORLDS))[0]
            allowed = there & (executed == targets)  # otherwise its limits are those of another target
            for side in range(2):
                limit = np.array([scaled(x) for x in guard.limits[allowed, side]])
                assert shown[allowed, k, side] == pytest.approx(limit, abs=2e-3)
            compared[k] += allowed.sum()
            bound += (np.abs(guard.limits[allowed, 0]) < 2.0).sum()
            nowhere = (lane < 0) | (lane > 2)
            assert (shown[nowhere, k] == [-1.0, 1.0]).all()
        observations, *_ = env.step(np.stack([np.zeros(WORLDS), rng.uniform(-2.0, 2.0, WORLDS)], axis=1))
    assert (compared > 200).all()
    assert bound > 100


def test_a_limit_is_scaled_without_losing_its_order():
    limits = [-math.inf, -40.0, -2.0, -0.1, 0.0, 0.1, 2.0, 20.0, 40.0, math.inf]
    values = [scaled(limit) for limit in limits]
    assert values == sorted(values)
    assert values[0] == values[1] == -1.0
    assert values[-1] == values[-2] == 1.0
    assert values[6] == pytest.approx(math.log(3.0) / math.log(41.0))


@pytest.mark.parametrize("scenario", ["a", "b"])
def test_the_observed_world_is_the_world_nearest_first(scenario):
    env = DrivingVectorEnv(scenario, WORLDS)
    observations, _ = env.reset(seed=2)
    for k in range(25):
        aside = 0.0 if k < 23 else 1.0
        observations, *_ = env.step(np.tile([aside, 0.5], (WORLDS, 1)))
    seen, world = observed_world(observations), env.world
    for name in ("s", "d", "speed", "lateral_speed", "heading"):
        assert seen.ego[name] == pytest.approx(world.ego[name], rel=1e-5, abs=1e-4)
    assert (world.ego["lateral_speed"] > 0.1).sum() > 20
    assert seen.ego["reference_d"] == pytest.approx(world.ego["d"], abs=1e-4)
    assert seen.ego["reference_speed"] == pytest.approx(world.ego["lateral_speed"], rel=1e-5, abs=1e-4)
    walking = 0
    for i in range(WORLDS):
        near = np.argsort(np.abs(world.vehicles["s"][i] - world.ego["s"][i]))
        near = [
            j
            for j in near
            if world.vehicles["present"][i, j] and abs(world.vehicles["s"][i, j] - world.ego["s"][i]) <= 200.0
        ]
        assert seen.vehicles["present"][i].sum() == len(near)
        for name in ("s", "d", "speed"):
            assert seen.vehicles[name][i, : len(near)] == pytest.approx(world.vehicles[name][i, near], abs=1e-3)
        crossing = world.pedestrians["d"][i][world.pedestrians["state"][i] == CROSSING]
        assert sorted(seen.pedestrians["d"][i][seen.pedestrians["state"][i] == CROSSING]) == pytest.approx(
            sorted(crossing), abs=1e-3
        )
        walks = (
            part.pedestrians["lateral_speed"][i][part.pedestrians["state"][i] == CROSSING] for part in (seen, world)
        )
        assert sorted(next(walks)) == pytest.approx(sorted(next(walks)), abs=1e-3)
        walking += len(crossing)
    assert (walking > 0) == (scenario == "b")


def test_the_guard_asks_its_model_once_for_what_the_policy_saw():
    model = Model()
    guard = ShareGuard(model)
    env = DrivingVectorEnv("b", 4, shield=guard)
    observations, _ = env.reset(seed=2)
    GuardFeatures(guard)(observations)
    env.step(np.zeros((4, 2)))
    assert model.asked == 1
    assert guard.shares(env.world) == pytest.approx(0.1 + 0.8 * observations[:, 2].astype(float))


def test_the_shuffled_control_shows_what_it_will_do_however_often_it_is_asked():
    guard = ShareGuard(Model(), share="shuffled")
    guard.begin(np.random.SeedSequence(3))
    one, _ = DrivingVectorEnv("a", 4).reset(seed=1)
    two, _ = DrivingVectorEnv("a", 4).reset(seed=2)
    first = guard.demand(one).shares.copy()
    guard.demand(two)
    assert np.array_equal(guard.demand(one).shares, first)
    guard.begin(np.random.SeedSequence(4))
    assert not np.intersect1d(guard.demand(one).shares, first).size


def test_the_learner_sees_the_features_of_every_observation_the_last_of_an_episode_too():
    guard = SafetyGuard(3.0)
    features = GuardFeatures(guard)
    env = StableBaselinesEnv(DrivingVectorEnv("a", 8, shield=guard), features)
    assert env.observation_space.shape == (47 + FEATURES,)
    assert env.reset().shape == (8, 47 + FEATURES)
    ends = 0
    while ends < 8:
        env.step_async(np.tile([0.0, 2.0], (8, 1)))
        observations, _, dones, infos = env.step_wait()
        assert np.array_equal(observations, features(observations[:, :47]))
        for i in np.flatnonzero(dones):
            last = infos[i]["terminal_observation"]
            assert np.array_equal(last, features(last[None, :47])[0])
            assert last[0] > observations[i, 0]
            ends += 1


def test_an_aware_policy_is_saved_and_needs_its_features(tmp_path):
    method = get_method("safety-guard:aware=true")
    task = Task(get_scenario("a"), 0, Budget(4_000), cache=tmp_path)
    policy = method.train(task)
    policy.save(tmp_path)
    observations, _ = DrivingVectorEnv("a", 8).reset(seed=3)
    assert np.array_equal(method.load_policy(tmp_path, task).act(observations), policy.act(observations))
    with pytest.raises(PolicyFileError, match=r"53 .* 47"):
        get_method("safety-guard").load_policy(tmp_path, task)


@pytest.mark.parametrize(("tc", "least"), [(1.0, 0.620), (3.0, 0.415), (7.0, 0.381)])
def test_a_feature_jumps_by_what_is_written_where_a_standing_body_comes_within_reach(tc, least):
    # At reach the gap is 3.6 v + T_c v + 1.5 T_c^2 + 3 m, so that Eq. (SCA) gives 3 + 6 / T_c^2.
    at = reach(10.0, tc)
    world = scene([(at - 5.0, 0.0, 0.0)])
    for ds, expected in ((at + 1e-6, 1.0), (at - 1e-6, least)):
        world.vehicles["s"] = ds
        assert scaled(limits(world, tc=tc)[0]) == pytest.approx(expected, abs=1e-3)
    assert scaled(3.0 + 6.0 / tc**2) == pytest.approx(least, abs=1e-3)


def test_the_literal_method_keeps_the_corrections():
    options = get_method("safety-guard:literal=true").shield().options
    assert options == GuardOptions(True, True, True, True, True, True, True, True, True)
    assert get_method("safety-guard:literal=true,reserve=false").shield().options.reserve is False
