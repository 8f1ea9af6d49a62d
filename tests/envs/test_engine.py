"""One step of a world: the four endings, rewards, costs and the episode's record."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs import engine
from envs.engine import STEPS_MAX
from envs.layout import sample_initial_worlds
from envs.reward import comfort_reward, lane_deviation_reward, speed_reward
from envs.scenario import get_scenario
from envs.terms import CostSignal
from envs.world import CROSSING, Ending, Fault, World
from tests.envs.small_worlds import advance, one_world

kernels = pytest.mark.kernels
COLLISION, PROXIMITY, TTC = (int(signal) for signal in CostSignal)


@kernels
def test_the_goal_ends_an_episode_at_760_m() -> None:
    world = one_world({"s": 758.9, "speed": 10.0})
    advance(world)
    assert world.episode.ending[0] == Ending.RUNNING
    advance(world)
    assert world.episode.ending[0] == Ending.GOAL
    exact = one_world({"s": 760.0})
    advance(exact)
    assert exact.episode.ending[0] == Ending.GOAL


@kernels
@pytest.mark.parametrize("d", [5.2501, -5.2501])
def test_a_centre_beyond_the_edge_is_off_road(d: float) -> None:
    world = one_world({"d": d})
    advance(world, d)
    assert world.episode.ending[0] == Ending.OFF_ROAD
    on_the_edge = one_world({"d": math.copysign(5.25, d)})
    advance(on_the_edge, on_the_edge.ego.d[0])
    assert on_the_edge.episode.ending[0] == Ending.RUNNING


@kernels
def test_an_episode_times_out_after_90_s() -> None:
    assert STEPS_MAX == 900
    world = one_world()
    world.episode["steps"] = STEPS_MAX - 2
    advance(world)
    assert world.episode.ending[0] == Ending.RUNNING
    advance(world)
    assert world.episode.ending[0] == Ending.TIME_OUT


@kernels
def test_a_collision_at_the_goal_counts_as_a_collision() -> None:
    world = one_world({"s": 759.5, "speed": 10.0, "d": 5.26}, [{"s": 760.5, "d": 3.5, "speed": 10.0}])
    world.episode["steps"] = STEPS_MAX
    advance(world, 5.26)
    assert world.episode.ending[0] == Ending.COLLISION


@kernels
def test_off_road_comes_before_the_goal_and_the_goal_before_the_time_limit() -> None:
    world = one_world({"s": 759.5, "speed": 10.0, "d": 5.26})
    advance(world, 5.26)
    assert world.episode.ending[0] == Ending.OFF_ROAD
    world = one_world({"s": 759.5, "speed": 10.0})
    world.episode["steps"] = STEPS_MAX
    advance(world)
    assert world.episode.ending[0] == Ending.GOAL


@kernels
def test_rewards_of_one_step_by_hand() -> None:
    # From 9.8 m/s at 2 m/s2 to 10 m/s: 0.5 + 4 x 2 / 5.89. Half a metre off the centre: -0.5. The target moved
    # from 0 to 0.5 m, the command from 0.8 to 2: -0.5 (0.5 / 7 + 1.2 / 4).
    world = one_world({"speed": 9.8, "d": 0.5, "target_d": 0.0, "command": 0.8})
    driving, comfort, risk, cost = advance(world, 0.5, 2.0, intervened=True)
    assert driving == pytest.approx(0.5 + 8.0 / 5.89 - 0.5)
    assert comfort == pytest.approx(-0.5 * (0.5 / 7.0 + 0.3))
    assert (risk, cost) == (-5.0, 0.0)
    assert (world.ego.target_d[0], world.ego.command[0]) == (0.5, 2.0)
    # The same again: nothing changed, so comfort is 0.
    assert advance(world, 0.5, 2.0)[1] == 0.0


@kernels
def test_a_collision_costs_1_and_50_on_top_of_speed_and_lane_deviation() -> None:
    world = one_world({"speed": 10.0}, [{"s": 5.5, "speed": 1.0}])
    driving, _, risk, cost = advance(world)
    assert driving == pytest.approx(speed_reward(10.0) - 50.0)
    assert (risk, cost) == (0.0, 1.0)


@kernels
def test_commands_are_clipped_to_2_mps2_before_they_count() -> None:
    world = one_world({"speed": 5.0})
    assert advance(world, 0.0, 9.0)[1] == pytest.approx(comfort_reward(0.0, 0.0, 2.0, 0.0))
    assert (world.ego.acceleration[0], world.ego.command[0]) == (2.0, 2.0)
    assert advance(world, 0.0, -9.0)[1] == pytest.approx(comfort_reward(0.0, 0.0, -2.0, 2.0))


@kernels
@pytest.mark.parametrize(
    ("gap", "speed", "cost"),
    [
        # After the step: S_safe 36 m at 10 m/s; time to collision gap / 5 against 1.5 s.
        (36.5, 5.0, {COLLISION: 0.0, PROXIMITY: 0.0, TTC: 0.0}),
        (35.5, 5.0, {COLLISION: 0.0, PROXIMITY: 1.0, TTC: 0.0}),
        (7.51, 5.0, {COLLISION: 0.0, PROXIMITY: 1.0, TTC: 0.0}),
        (7.49, 5.0, {COLLISION: 0.0, PROXIMITY: 1.0, TTC: 1.0}),
        (-0.1, 5.0, {COLLISION: 1.0, PROXIMITY: 1.0, TTC: 1.0}),
    ],
)
def test_cost_signals_by_hand(gap: float, speed: float, cost: dict[int, float]) -> None:
    for signal, expected in cost.items():
        leader = {"s": 5.0 + gap + 0.1 * (10.0 - speed), "speed": speed}
        world = one_world({"speed": 10.0}, [leader])
        assert advance(world, cost_signal=signal)[3] == expected
        assert world.episode.cost[0] == expected
        assert world.episode.steps_inside_safe_gap[0] == cost[PROXIMITY]
        assert world.episode.steps_low_ttc[0] == cost[TTC]


@kernels
def test_a_rear_end_collision_costs_whatever_is_ahead() -> None:
    for signal in CostSignal:
        world = one_world({"speed": 1.0}, [{"s": -5.5, "speed": 12.0}])
        assert advance(world, cost_signal=int(signal))[3] == 1.0


@kernels
def test_the_record_of_an_episode_by_hand() -> None:
    # Four steps from 10 m/s, at 2, 2, -2 and -2 m/s2: speeds 10.2, 10.4, 10.2, 10; 1 + 1.02 + 1.04 + 1.02 m.
    world = one_world({"speed": 10.0, "d": 1.7}, [{"s": 45.0, "speed": 8.0}])
    for command in (2.0, 2.0, -2.0, -2.0):
        advance(world, 1.7, command, intervened=command < 0.0, proposed=(2.2, 1.5))
    e = world.episode[0]
    assert (e.steps, e.ending, e.fault, e.lane_changes) == (4, Ending.RUNNING, Fault.NONE, 0)
    assert e.distance == pytest.approx(4.08)
    speeds = (10.2, 10.4, 10.2, 10.0)
    assert e.return_driving == pytest.approx(sum(speed_reward(v) for v in speeds) - 4 * 1.7)
    assert e.return_comfort == pytest.approx(-0.5 * (0.5 + 0.0 + 1.0 + 0.0))
    assert (e.return_risk, e.interventions) == (-10.0, 2)
    # All four differ from the proposal, by 0.5, 0.5, 3.5, 3.5 m/s2 and 0.5 m each.
    assert (e.altered, e.altered_acceleration, e.altered_target) == pytest.approx((4, 8.0, 2.0))
    assert (e.acceleration_min, e.steps_hard_braking) == (-2.0, 2)
    # |2 - 0| + 0 + |-2 - 2| + 0, over 0.1 s.
    assert e.jerk_sum == pytest.approx(60.0)
    # Gap 40 m less what the ego gains at 2, 2.2, 2.4 and 2.2 m/s: 39.8, 39.58, 39.34, 39.12 m; S_safe is never
    # undercut (36.72, 37.44, 36.72, 36 m). Time to collision at closing speeds of 2.2, 2.4, 2.2 and 2 m/s.
    assert e.steps_inside_safe_gap == e.steps_low_ttc == 0
    assert e.ttc_min == pytest.approx(39.58 / 2.4)


@kernels
@pytest.mark.parametrize(("command", "count"), [(-1.8, 1), (-1.7999, 0)])
def test_hard_braking_starts_at_1_8_mps2(command: float, count: int) -> None:
    world = one_world({"speed": 10.0})
    advance(world, 0.0, command)
    assert world.episode.steps_hard_braking[0] == count


@kernels
def test_actions_that_the_shield_returns_unchanged_are_not_altered() -> None:
    world = one_world({"speed": 10.0})
    advance(world, 1.0, 0.5, intervened=True, proposed=(1.0, 0.5))
    e = world.episode[0]
    assert (e.interventions, e.altered, e.altered_acceleration, e.altered_target) == (1, 0, 0.0, 0.0)


@kernels
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_lane_change_counts_once_and_its_tracking_error_is_kept(side: float) -> None:
    world = one_world({"speed": 10.0, "reference_d": -0.3 * side})
    advance(world, 3.5 * side, steps=60)
    assert world.episode.lane_changes[0] == 1
    assert 0.2 < world.episode.tracking_error_max[0] < 0.3


@kernels
def test_planning_follows_the_quartic_to_the_target_speed_and_counts_no_altered_acceleration() -> None:
    world = one_world({"speed": 8.0})
    advance(world, speed=10.0, horizon=4.0)
    # From 8 to 10 m/s in 4 s: c3 = 2 / 16, c4 = -2 / 128: 6 c3 t + 12 c4 t^2 at 0.1 s = 0.075 - 0.001875.
    assert world.ego.acceleration[0] == pytest.approx(0.073125)
    advance(world, speed=10.0, horizon=4.0, steps=200)
    assert world.ego.speed[0] == pytest.approx(10.0, abs=0.05)
    assert world.episode.altered_acceleration[0] == world.episode.altered[0] == 0


@kernels
def test_a_finished_world_stands_still() -> None:
    world = one_world({"s": 759.5, "speed": 10.0}, [{"s": 10.0, "speed": 8.0}])
    sums = advance(world, steps=5)
    assert world.episode.steps[0] == 1
    assert sums[0] == pytest.approx(speed_reward(10.0))
    before = world.copy()
    assert (advance(world, steps=5) == 0.0).all()
    assert before.ego.tobytes() == world.ego.tobytes()
    assert before.vehicles.tobytes() == world.vehicles.tobytes()
    assert before.episode.tobytes() == world.episode.tobytes()


@kernels
def test_traffic_decides_on_the_state_before_the_ego_moves() -> None:
    # The follower sees the ego 10 m ahead and at 10 m/s, as both are at the start of the step.
    world = one_world({"s": 0.0, "speed": 10.0}, [{"s": -20.0, "speed": 10.0, "desired_speed": 12.0}])
    advance(world, 0.0, -2.0)
    expected = 3.0 * (1.0 - (10.0 / 12.0) ** 4) - 3.0 * (25.0 / 20.0) ** 2
    assert world.vehicles.acceleration[0, 0] == pytest.approx(expected)
    assert world.vehicles.s[0, 0] == -19.0


@kernels
def test_pedestrians_see_where_the_ego_has_gone_in_the_same_step() -> None:
    # 60.5 m ahead before the step, 59.5 m after it, with a trigger gap of 60 m.
    person = {"s": 63.3, "d": 5.75, "lateral_speed": -1.0, "trigger_gap": 60.0}
    world = one_world({"speed": 10.0}, [], [person])
    advance(world)
    assert world.pedestrians.state[0, 0] == CROSSING


@kernels
@given(
    st.lists(st.tuples(st.floats(-4.25, 4.25), st.floats(-2.0, 2.0), st.booleans()), min_size=1, max_size=12),
    st.floats(0.0, 13.89),
)
def test_returns_are_the_sums_of_the_rewards_of_the_steps(
    actions: list[tuple[float, float, bool]], speed: float
) -> None:
    world = one_world({"speed": speed}, [{"s": 15.0, "speed": 4.0}])
    total, expected = np.zeros(4), np.zeros(2)
    for target, command, flagged in actions:
        if world.episode.ending[0] != Ending.RUNNING:
            break
        before = (float(world.ego.target_d[0]), float(world.ego.command[0]))
        total += advance(world, target, command, intervened=flagged)
        ego = world.ego[0]
        crash = -50.0 if world.episode.ending[0] == Ending.COLLISION else 0.0
        expected[0] += speed_reward(float(ego.speed)) + lane_deviation_reward(float(ego.d)) + crash
        expected[1] += comfort_reward(target, before[0], command, before[1])
    e = world.episode[0]
    assert [e.return_driving, e.return_comfort, e.return_risk, e.cost] == pytest.approx(total.tolist())
    assert total[:2] == pytest.approx(expected)
    assert e.return_risk == -5.0 * e.interventions
    assert e.distance == pytest.approx(world.ego.s[0])


def drive(name: str, n: int, parallel: bool) -> World:
    """Random actions in many worlds for 300 steps."""
    scenario = get_scenario(name)
    world = sample_initial_worlds(scenario, np.random.SeedSequence(4), n)
    rng = np.random.default_rng(1)
    kernel = engine.advance_parallel if parallel else engine.advance
    quiet, zeros, horizon = np.zeros(n, np.bool_), np.zeros(n), np.full(n, 3.0)
    for _ in range(60):
        target, command = rng.uniform(-4.25, 4.25, n), rng.uniform(-1.0, 2.0, n)
        kernel(
            world.ego, world.vehicles, world.pedestrians, world.episode, target, command, horizon, zeros,
            target, command, quiet, 5, False, scenario.lane_changes, True, PROXIMITY, np.zeros((n, 4)),
        )  # fmt: skip
    return world


@pytest.mark.parametrize("name", ["b", "a-dense-mobil"])
def test_the_parallel_kernel_gives_the_same_bytes(name: str) -> None:
    one, other = drive(name, 33, parallel=False), drive(name, 33, parallel=True)
    for field in ("ego", "vehicles", "pedestrians", "episode"):
        assert getattr(one, field).tobytes() == getattr(other, field).tobytes()
    assert len(np.unique(one.episode["steps"])) > 1
