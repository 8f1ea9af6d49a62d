"""Lanes, gaps and rectangles, held against hand values and against polygon clipping."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from envs.geometry import (
    PEDESTRIAN_SIZE_M,
    ROAD_EDGE_M,
    VEHICLE_LENGTH_M,
    VEHICLE_WIDTH_M,
    bumper_gap,
    lane_centre,
    nearest_lane,
    rectangles_overlap,
)

pytestmark = pytest.mark.kernels

CAR = (VEHICLE_LENGTH_M, VEHICLE_WIDTH_M)

Points = list[tuple[float, float]]


def corners(s: float, d: float, heading: float, length: float, width: float) -> Points:
    """Corners of a rectangle, counter-clockwise."""
    cos, sin = math.cos(heading), math.sin(heading)
    ends = [(1, -1), (1, 1), (-1, 1), (-1, -1)]
    local = [(0.5 * length * x, 0.5 * width * y) for x, y in ends]
    return [(s + x * cos - y * sin, d + x * sin + y * cos) for x, y in local]


def clip(polygon: Points, a: tuple[float, float], b: tuple[float, float]) -> Points:
    """Part of a convex polygon to the left of the line from a to b (Sutherland and Hodgman 1974)."""

    def side(p: tuple[float, float]) -> float:
        return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])

    kept: Points = []
    for p, q in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        if side(p) >= 0:
            kept.append(p)
        if side(p) * side(q) < 0:
            t = side(p) / (side(p) - side(q))
            kept.append((p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])))
    return kept


def shared_area(one: Points, other: Points) -> float:
    for a, b in zip(other, other[1:] + other[:1], strict=True):
        one = clip(one, a, b)
    pairs = zip(one, one[1:] + one[:1], strict=True)
    return 0.5 * abs(sum(p[0] * q[1] - p[1] * q[0] for p, q in pairs))


def test_lane_centres_are_a_lane_width_apart_and_the_middle_one_is_zero() -> None:
    assert [lane_centre(lane) for lane in range(3)] == [-3.5, 0.0, 3.5]
    assert ROAD_EDGE_M == 5.25


@pytest.mark.parametrize(
    ("d", "lane"),
    [
        (-9.0, 0), (-3.5, 0), (-1.7500001, 0), (-1.75, 0), (-1.7499999, 1), (0.0, 1),
        (1.75, 1), (1.7500001, 2), (3.5, 2), (9.0, 2),
    ],
)  # fmt: skip
def test_nearest_lane_breaks_ties_to_the_lower_index_and_ends_at_the_outer_lanes(d: float, lane: int) -> None:
    assert nearest_lane(d) == lane


@given(st.floats(-20.0, 20.0))
def test_no_lane_centre_is_nearer_than_that_of_the_nearest_lane(d: float) -> None:
    distances = [abs(d - lane_centre(lane)) for lane in range(3)]
    assert distances[nearest_lane(d)] <= min(distances) + 1e-12


def test_bumper_gap_is_the_centre_distance_less_both_half_lengths() -> None:
    # 12 m between centres of two 5 m cars: 12 - 2.5 - 2.5 = 7. A pedestrian: 12 - 2.5 - 0.3 = 9.2.
    assert bumper_gap(12.0, 5.0) == 7.0
    assert bumper_gap(-12.0, 5.0) == 7.0
    assert bumper_gap(12.0, PEDESTRIAN_SIZE_M) == pytest.approx(9.2)
    assert bumper_gap(4.0, 5.0) == -1.0


@given(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
def test_aligned_cars_overlap_only_where_the_bumper_gap_is_negative_or_zero(ds: float, dd: float) -> None:
    overlap = rectangles_overlap(ds, dd, 0.0, *CAR, 0.0, *CAR)
    assert overlap == (bumper_gap(ds, VEHICLE_LENGTH_M) <= 0.0 and abs(dd) <= VEHICLE_WIDTH_M)


@pytest.mark.parametrize(
    ("ds", "dd", "heading_a", "heading_b", "overlap"),
    [
        (5.0, 2.0, 0.0, 0.0, True),  # corners touch
        (5.0001, 0.0, 0.0, 0.0, False),
        (0.0, 2.0001, 0.0, 0.0, False),
        # A car turned by 90 degrees reaches 1.0 m along the road and 2.5 m across: contact at 3.5 and 3.5 m.
        (3.5 - 1e-9, 0.0, 0.0, 0.5 * math.pi, True),
        (3.5 + 1e-6, 0.0, 0.0, 0.5 * math.pi, False),
        (0.0, 3.5 - 1e-9, 0.0, 0.5 * math.pi, True),
        (0.0, 3.5 + 1e-6, 0.0, 0.5 * math.pi, False),
        # A car turned by 45 degrees reaches (2.5 + 1) / sqrt(2) = 2.4749 m along the road: its corner meets the
        # other's front bumper at 2.5 + 2.4749 m. The corner lies (2.5 - 1) / sqrt(2) = 1.06 m off its centre.
        (2.5 + 3.5 / math.sqrt(2) - 1e-9, 1.0, 0.0, 0.25 * math.pi, True),
        (2.5 + 3.5 / math.sqrt(2) + 1e-6, 1.0, 0.0, 0.25 * math.pi, False),
        # On the other side that corner passes the other's corner: apart, though both projections overlap.
        (2.5 + 3.5 / math.sqrt(2) - 0.1, -1.0, 0.0, 0.25 * math.pi, False),
        (2.5 + 3.5 / math.sqrt(2) - 0.1, -1.0, 0.0, -0.25 * math.pi, True),
        # Both turned so that a corner points along the road: half diagonals of sqrt(2.5^2 + 1) = 2.6926 m meet.
        (5.385, 0.0, -math.atan(0.4), -math.atan(0.4), True),
        (5.3853, 0.0, -math.atan(0.4), -math.atan(0.4), False),
        (0.0, 5.385, math.atan(2.5), math.atan(2.5), True),
        # Nose to tail along the same diagonal: contact at 5 m of it.
        (4.999 / math.sqrt(2), 4.999 / math.sqrt(2), 0.25 * math.pi, 0.25 * math.pi, True),
        (5.001 / math.sqrt(2), 5.001 / math.sqrt(2), 0.25 * math.pi, 0.25 * math.pi, False),
        (5.001 / math.sqrt(2), -5.001 / math.sqrt(2), -0.25 * math.pi, -0.25 * math.pi, False),
        # Side by side along it: contact at 2 m.
        (1.999 * math.sin(-0.25 * math.pi), 1.999 * math.cos(-0.25 * math.pi), 0.25 * math.pi, 0.25 * math.pi, True),
        (2.001 * math.sin(-0.25 * math.pi), 2.001 * math.cos(-0.25 * math.pi), 0.25 * math.pi, 0.25 * math.pi, False),
    ],
)  # fmt: skip
def test_overlap_of_two_cars_by_hand(ds: float, dd: float, heading_a: float, heading_b: float, overlap: bool) -> None:
    assert rectangles_overlap(ds, dd, heading_a, *CAR, heading_b, *CAR) is overlap


HEADINGS = st.floats(-math.pi, math.pi)
OFFSETS = st.floats(-7.0, 7.0)


@given(OFFSETS, OFFSETS, HEADINGS, HEADINGS, st.sampled_from([CAR, (0.6, 0.6)]))
def test_overlap_agrees_with_the_shared_area_of_the_polygons(
    ds: float, dd: float, heading_a: float, heading_b: float, size: tuple[float, float]
) -> None:
    area = shared_area(corners(0.0, 0.0, heading_a, *CAR), corners(ds, dd, heading_b, *size))
    assume(area == 0.0 or area > 1e-6)
    overlap = rectangles_overlap(ds, dd, heading_a, *CAR, heading_b, *size)
    if area > 0.0:
        assert overlap
    else:
        assert not rectangles_overlap(ds * 1.001, dd * 1.001, heading_a, *CAR, heading_b, *size)


@given(OFFSETS, OFFSETS, HEADINGS, HEADINGS)
def test_overlap_does_not_depend_on_which_body_is_first(
    ds: float, dd: float, heading_a: float, heading_b: float
) -> None:
    one = rectangles_overlap(ds, dd, heading_a, *CAR, heading_b, 0.6, 0.6)
    assert one == rectangles_overlap(-ds, -dd, heading_b, 0.6, 0.6, heading_a, *CAR)
