"""Decisions in closed loop that a driver would call wrong, stated as what is right."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from replanning import begun_since, threads, threads_end
from scenes import disc, scene

import scp_planner as sp
from scp_planner.arrays import Array

PERIOD = 0.1
FINE = np.linspace(0.0, PERIOD, 11)
"""s after a replan, at which a vehicle is looked at that follows its plan exactly."""
Feed = Callable[[float, Array], None]


def drive(planner: sp.Planner, until: float, feed: Feed | None = None) -> Iterator[Array]:
    """Drive a planner's plans; after each replan give time, place and speed, (11, 4), up to the next one."""
    start = planner.scenario.start
    place, heading, speed = np.array(start.position, dtype=float), start.heading, start.speed
    for time in np.arange(start.time, until, PERIOD):
        if feed is not None:
            feed(float(time), place)
        plan = planner.replan(float(time), place, heading, speed)
        times = time + FINE
        yield np.column_stack([times, plan.position(times), plan.speed(times)])
        place, heading = plan.position(times[-1]), float(plan.heading(times[-1]))
        speed = max(float(plan.speed(times[-1])), 0.0)


def road(
    start: tuple[float, float, float, float], length: float, bounds: list[list[float]], **vehicle: float
) -> sp.Scenario:
    """An empty road, from a place, heading and speed."""
    limits = {"radius": 1.0, "max_acceleration": 2.0, "max_deceleration": 5.0, "max_lateral_acceleration": 3.0}
    return sp.Scenario(
        vehicle={**limits, "max_curvature": 0.2, **vehicle},
        start={"time": 0.0, "position": start[:2], "heading": start[2], "speed": start[3]},
        goal={"position": [length, 0.0]},
        bounds={"min": bounds[0], "max": bounds[1]},
    )


def test_nobody_waits_in_the_way_of_a_lorry_that_comes() -> None:
    """The lorry is 12 m long, comes at 8 m/s, and its side is in the middle of the road; beside it is room."""
    planner = sp.Planner(road((0.0, 0.0, 0.0, 10.0), 100.0, [[-20.0, -2.5], [140.0, 6.0]], max_speed=12.0))
    spread, rng = 0.05, np.random.default_rng(1)
    shape = {"rectangle": [12.0, 2.6], "heading": math.pi}
    planner.add_obstacle("lorry", shape, covariance=spread**2 * np.eye(2), model="car")

    def feed(time: float, _: Array) -> None:
        planner.observe("lorry", time, np.array([110.0 - 8.0 * time, 1.3]) + spread * rng.standard_normal(2))

    for time in np.arange(-3.0, 0.0, PERIOD):
        feed(float(time), np.zeros(2))
    for driven in drive(planner, 13.0, feed):
        beyond = np.abs(driven[:, 1:3] - np.column_stack([110.0 - 8.0 * driven[:, 0], np.full(len(driven), 1.3)]))
        beyond -= [6.0, 1.3]
        clearance = np.hypot(*np.maximum(beyond, 0.0).T) + np.minimum(beyond.max(axis=1), 0.0) - 1.0
        assert clearance.min() >= 0.0, driven[np.argmin(clearance)]
    assert driven[-1, 3] > 1.0, "it stands askew at the border, where it cannot drive on"


def test_what_cannot_be_stopped_for_is_braked_for_all_the_same() -> None:
    """A box is suddenly 8 m ahead, right across the road; stopping takes 10 m."""
    planner = sp.Planner(road((0.0, 0.0, 0.0, 10.0), 80.0, [[-10.0, -2.0], [90.0, 2.0]], max_speed=10.0))
    ahead = 8.0
    appeared: list[tuple[float, float]] = []

    def feed(time: float, place: Array) -> None:
        if time >= 0.3 and not appeared:
            appeared.append((time, float(place[0])))
            box = {"id": "box", "shape": {"disc": 1.0}, "motion": {"position": [place[0] + ahead + 2.0, 0.0]}}
            planner.add_obstacle(box)

    driven = np.concatenate(list(drive(planner, 4.0, feed)))
    seen, place = appeared[0]
    speed = driven[driven[:, 0] >= seen - 1e-9, 3]
    touching = driven[:, 1] >= place + ahead
    least = math.sqrt(10.0**2 - 2.0 * 5.0 * ahead)
    assert not touching.any() or driven[np.argmax(touching), 3] <= 1.1 * least
    assert np.diff(speed).max() <= 1e-6
    assert speed[-1] <= 1e-3


def test_an_empty_road_is_driven_on() -> None:
    """It stands askew, 0.5 m beside the border, for somebody who goes. Turning away at full lock takes 0.42 m."""
    stands = (143.34, -0.5, -0.414, 0.0)
    planner = sp.Planner(road(stands, 250.0, [[-100.0, -2.0], [350.0, 5.5]], max_speed=14.0))
    planner.add_obstacle({"id": "ahead", "shape": {"disc": 1.2}, "motion": {"position": [145.5, -1.2]}})

    def feed(time: float, _: Array) -> None:
        if time == 0.5:
            planner.remove_obstacle("ahead")

    driven = list(drive(planner, 6.0, feed))
    assert np.hypot(*(driven[-1][-1, 1:3] - np.array(stands[:2]))) > 1.0


class Tracker:
    """A Kalman filter of a constant velocity with white acceleration."""

    noise = 0.05**2 * np.eye(2)
    step = np.kron(np.array([[1.0, PERIOD], [0.0, 1.0]]), np.eye(2))
    grows = 0.15 * np.kron(np.array([[PERIOD**3 / 3, PERIOD**2 / 2], [PERIOD**2 / 2, PERIOD]]), np.eye(2))

    def __init__(self, place: Array) -> None:
        self.state, self.spread = np.r_[place, 0.0, 0.0], np.diag([0.0025, 0.0025, 1.0, 1.0])

    def take(self, place: Array) -> None:
        spread = self.step @ self.spread @ self.step.T + self.grows
        gain = spread[:, :2] @ np.linalg.inv(spread[:2, :2] + self.noise)
        ahead = self.step @ self.state
        self.state = ahead + gain @ (place - ahead[:2])
        spread = spread - gain @ spread[:2]
        self.spread = 0.5 * (spread + spread.T)


class Pavement:
    """15 people who walk up and down a pavement, 5 m wide, and are tracked."""

    def __init__(self, seed: int, count: int = 15, length: float = 40.0) -> None:
        self.rng = rng = np.random.default_rng(seed)
        self.place = np.column_stack([rng.uniform(6.0, length - 3.0, count), rng.uniform(-1.6, 1.6, count)])
        pace = rng.choice([-1, 1], count) * rng.uniform(0.8, 1.5, count)
        self.velocity = np.column_stack([pace, rng.normal(0.0, 0.05, count)])
        self.trackers = [Tracker(each + rng.normal(0.0, 0.05, 2)) for each in self.place]
        for _ in range(20):
            self.walk()

    def walk(self) -> None:
        count = len(self.place)
        self.velocity += np.column_stack([self.rng.normal(0.0, 0.03, count), self.rng.normal(0.0, 0.05, count)])
        across = self.place[:, 1]
        self.velocity[:, 1] -= 0.1 * (np.abs(across) > 1.5) * np.sign(across)
        self.place = self.place + PERIOD * self.velocity
        for tracker, each in zip(self.trackers, self.place, strict=True):
            tracker.take(each + self.rng.normal(0.0, 0.05, 2))


def test_a_robot_stays_on_its_pavement_and_is_not_walked_into() -> None:
    people, limits = Pavement(seed=1), {"min": [-2.0, -2.5], "max": [42.0, 2.5]}
    robot = {"radius": 0.35, "max_speed": 1.5, "max_acceleration": 1.0, "max_deceleration": 1.5, "max_curvature": 2.0}
    planner = sp.Planner(
        sp.Scenario(
            vehicle={**robot, "steering": "on_the_spot"},
            start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0},
            goal={"position": [40.0, 0.0], "speed": 0.0},
            bounds=limits,
            confidence={"probability": 0.95, "level": "per_time"},
        ),
        online=sp.OnlineSettings(period=PERIOD),
    )
    for k, each in enumerate(people.trackers):
        start = {"time": 0.0, "position": each.state[:2], "velocity": each.state[2:], "covariance": each.spread}
        planner.add_obstacle({"id": f"p{k}", "shape": {"disc": 0.3}, "model": "pedestrian", "estimate": start})

    def feed(time: float, _: Array) -> None:
        for k, each in enumerate(people.trackers):
            known = {"position": each.state[:2], "velocity": each.state[2:], "covariance": each.spread}
            planner.update_obstacle(f"p{k}", time, **known)

    for driven in drive(planner, 15.0, feed):
        people.walk()
        places = driven[:, 1:3]
        room = np.minimum(places - limits["min"], np.array(limits["max"]) - places).min() - robot["radius"]
        assert room >= -1e-3
        assert np.hypot(*(people.place - places[-1]).T).min() >= robot["radius"] + 0.3


def test_a_search_for_ways_goes_on_in_the_next_replan_and_ends_with_its_planner() -> None:
    before = threads()
    posts = [disc(f"post{k}", (2.0 + 0.8 * k, (-1.0) ** k * 0.4), (0.0, 0.1), radius=0.3) for k in range(24)]
    planner = sp.Planner(scene(*posts, goal={"position": (22.0, 0.0)}))
    planner.replan(0.0, (0.0, 0.0), 0.0, 0.0, deadline=1e-4)
    assert begun_since(before)
    for number in range(200):
        planner.replan(0.01 * number, (0.0, 0.0), 0.0, 0.0, deadline=5e-3)
        if not begun_since(before):
            break
    assert threads_end(before)
    planner = sp.Planner(scene(*posts, goal={"position": (22.0, 0.0)}))
    planner.replan(0.0, (0.0, 0.0), 0.0, 0.0, deadline=1e-4)
    assert begun_since(before)
    del planner
    assert threads_end(before)
