"""The independent check must pass exact trips that touch obstacles, and catch those that cut them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from exact_trips import refused, scenario, straight_trip
from scenes import scene
from scipy.interpolate import CubicSpline

import scp_planner
from scp_planner.arrays import Array
from verification.dense_check import check_trip
from verification.distances import distance_to_ellipses, distance_to_polygon, distance_to_uncertain, signed_distance


@pytest.mark.parametrize("later", [0.0, 100.0])
def test_touching_an_accelerating_disc_holds_and_a_millimetre_inside_is_caught(later: float) -> None:
    position, duration = straight_trip()

    def delayed(t: Array) -> Array:
        return position(t - later)

    def with_disc(cut: float) -> dict[str, Any]:
        # Passes the line y = 0 sideways at t = 3 s, always `keep` above the vehicle's own track there.
        keep = 0.3 + 0.5 - cut
        meeting = float(position(np.array([3.0]))[0, 0])
        when = 3.0 + later
        acceleration = np.array([0.0, 0.4])
        velocity = np.array([3.0, 0.0]) - acceleration * when
        place = np.array([meeting, keep]) - velocity * when - acceleration * when**2 / 2.0
        motion = {
            "time": 0.0,
            "position": place.tolist(),
            "velocity": velocity.tolist(),
            "acceleration": acceleration.tolist(),
        }
        return scenario(
            start={"time": later, "position": [0.0, 0.0], "heading": 0.0, "speed": 1.0},
            obstacles=[{"id": "disc", "shape": {"disc": 0.5}, "motion": motion}],
        )

    touching = check_trip(with_disc(0.0), delayed, later, later + duration)
    assert touching.ok, str(touching)
    assert touching["clearance"].value == pytest.approx(0.0, abs=1e-6)
    assert touching["clearance"].time == pytest.approx(later + 3.0, abs=0.05)
    cutting = check_trip(with_disc(1e-3), delayed, later, later + duration)
    assert refused(cutting) == {"clearance"}
    assert cutting["clearance"].excess == pytest.approx(1e-3, abs=1e-6)
    assert cutting["clearance"].subject == "disc"


def test_a_cut_between_two_hundred_samples_is_caught() -> None:
    """A disc that crosses at 40 m/s is inside for a few hundredths of a second only."""
    position, duration = straight_trip()
    motion = {"position": [11.0, -160.1], "velocity": [0.0, 40.0]}
    data = scenario(obstacles=[{"id": "fast", "shape": {"disc": 0.1}, "motion": motion}])
    assert refused(check_trip(data, position, 0.0, duration)) == {"clearance"}


@pytest.mark.parametrize(
    ("shape", "half_height"),
    [
        ({"polygon": [[-1.0, -0.5], [1.0, -0.5], [1.0, 0.5], [-1.0, 0.5]]}, 0.5),
        ({"rectangle": [2.0, 1.0]}, 0.5),
        ({"rectangle": [1.0, 2.0]}, 1.0),
    ],
)
def test_polygons_and_rectangles_are_judged_to_the_millimetre(shape: dict[str, Any], half_height: float) -> None:
    position, duration = straight_trip()
    for cut, names in ((0.0, set()), (1e-3, {"clearance"})):
        motion = {"position": [5.0, half_height + 0.3 - cut], "velocity": [-0.2, 0.0]}
        data = scenario(obstacles=[{"id": "box", "shape": shape, "motion": motion}])
        assert refused(check_trip(data, position, 0.0, duration)) == names


def test_polygon_distance_against_shapely() -> None:
    geometry = pytest.importorskip("shapely.geometry", reason="shapely is not installed")
    corners = np.array([[0.0, 0.0], [2.0, 0.3], [1.2, 1.0], [1.8, 2.0], [0.1, 1.5]])
    polygon = geometry.Polygon(corners)
    points = np.random.default_rng(3).uniform(-2.0, 4.0, (400, 2))
    signed = distance_to_polygon(points, corners)
    for point, distance in zip(points, signed, strict=True):
        place = geometry.Point(point)
        expected = polygon.exterior.distance(place) * (-1.0 if polygon.contains(place) else 1.0)
        assert distance == pytest.approx(expected, abs=1e-12)


def test_distances_to_ellipses_against_their_support() -> None:
    """The distance to a convex set is the largest of n.y - h(n) over all unit vectors n."""
    rng = np.random.default_rng(4)
    roots = rng.normal(size=(60, 2, 2))
    matrices = roots @ roots.transpose(0, 2, 1) + 1e-3 * np.eye(2)
    points = rng.uniform(-6.0, 6.0, (60, 2))
    angles = np.linspace(0.0, 2.0 * np.pi, 200_001)
    normals = np.stack([np.cos(angles), np.sin(angles)])
    for point, matrix, distance in zip(points, matrices, distance_to_ellipses(points, matrices), strict=True):
        support = np.sqrt(np.einsum("in,ij,jn->n", normals, matrix, normals))
        assert distance == pytest.approx(max(0.0, float((point @ normals - support).max())), abs=1e-8)


@pytest.mark.parametrize("order", [1, 2])
def test_observed_obstacles_are_judged_with_their_region(order: int) -> None:
    """A disc that stands beside the track, seen with noise: the fit and its covariance by numpy's polyfit."""
    position, duration = straight_trip()
    rng = np.random.default_rng(8)
    when = np.linspace(-3.0, 0.0, 31)
    deviation = 0.02
    seen = np.array([10.0, 2.0]) + deviation * rng.normal(size=(when.size, 2))
    times = np.linspace(0.0, duration, 2001)
    fits = [np.polyfit(when, seen[:, i], order, cov="unscaled") for i in range(2)]
    centres = np.stack([np.polyval(fit, times) for fit, _ in fits], axis=1)
    powers = np.vander(times, order + 1)
    # Noise of one deviation in all directions: the region is a disc.
    radii = deviation * np.sqrt(9.0 * np.einsum("ni,ij,nj->n", powers, fits[0][1], powers))
    reach = np.linalg.norm(position(times) - centres, axis=1) - radii - 0.3
    touching = float(reach.min())
    for radius, names in ((touching - 1e-4, set()), (touching + 1e-3, {"clearance"})):
        observed = {
            "id": "seen",
            "shape": {"disc": radius},
            "observations": {
                "time": when.tolist(),
                "position": seen.tolist(),
                "covariance": [[deviation**2, 0.0], [0.0, deviation**2]],
            },
            "model": {"order": order},
        }
        report = check_trip(scenario(obstacles=[observed]), position, 0.0, duration, regions={"seen": 9.0})
        assert refused(report) == names
        assert report["clearance"].value == pytest.approx(touching - radius, abs=1e-5)


def test_priors_count_like_observations_of_velocity_and_acceleration() -> None:
    """Against the zones of the package: an obstacle seen twice, of which a prior says the rest."""
    obstacle = {
        "id": "new",
        "shape": {"disc": 0.4},
        "observations": {
            "time": [-0.1, 0.0],
            "position": [[5.0, 1.0], [5.1, 1.05]],
            "covariance": [[0.01, 0.002], [0.002, 0.02]],
        },
        "model": {
            "order": 2,
            "prior": {"velocity_deviation": 1.5, "acceleration": [0.2, 0.0], "acceleration_deviation": 0.5},
        },
    }
    scenario = scene(obstacle, confidence={"probability": 0.9, "level": "per_time"})
    (zone,) = scp_planner.zones(scenario)
    times = np.linspace(0.0, 4.0, 30)
    points = np.array([8.0, 8.0]) + np.random.default_rng(0).normal(0.0, 4.0, (30, 2))
    scale = -2.0 * math.log(0.1)  # chi-square of two degrees at 90 %
    distance = distance_to_uncertain(scenario.to_dict()["obstacles"][0], times, points, scale)
    inside = zone.signed_distance(times, points) <= -0.4
    assert 0 < inside.sum() < 30
    assert distance[~inside] == pytest.approx(zone.signed_distance(times, points)[~inside], abs=1e-6)
    assert np.all(distance[inside] <= -0.4 + 1e-9)


def test_of_a_rectangle_that_hardly_moves_only_the_disc_within_is_known() -> None:
    """It comes along x, turns round, and goes back: its velocity points along y while it turns."""
    motion = {"time": [0.0, 1.0, 2.0, 3.0, 4.0], "position": [[0, 0], [1, 0], [1.4, 0.05], [1, 0.1], [0, 0.1]]}
    obstacle = {"id": "car", "shape": {"rectangle": [2.0, 0.5]}, "motion": motion}
    at = np.array([0.5, 2.0])
    centres = CubicSpline(motion["time"], motion["position"], bc_type="natural")(at)
    found = signed_distance(obstacle, at, centres + np.array([0.0, 0.8]))
    assert found == pytest.approx([0.8 - 0.25, 0.8 - 0.25], abs=2e-3)
    found = signed_distance(obstacle, at, centres + np.array([1.2, 0.0]))
    assert found == pytest.approx([0.2, 1.2 - 0.25], abs=2e-3)
