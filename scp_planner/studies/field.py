"""A field that a vehicle crosses, its objective Q with true zones, and Q_n with zones from n observations."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from functools import cached_property
from hashlib import sha256
from importlib.resources import as_file, files

import numpy as np

from scp_planner.arrays import Array
from scp_planner.baseline.coordinates import Coordinates
from scp_planner.baseline.objective import PenalisedObjective
from scp_planner.baseline.priced import soft_excess, uniform
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.motions import Motion
from scp_planner.scenario.shapes import Disc
from scp_planner.scenario.values import Vector
from scp_planner.search.starts import starts
from scp_planner.settings.planning import SceneSettings
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import zones

PLANNER = SceneSettings(path_degree=4, path_span=2.5, acceleration_degree=1, acceleration_spans=8)
"""Smooth splines with few control points: with kinks in Q the minimiser would not be a smooth function of the data."""


@dataclass(frozen=True)
class FieldParameters:
    """Sizes of the compact set, and of the search for minimisers."""

    max_travel_time: float = 12.0  # s; of the trips in the compact set
    largest_offset: float = 3.0  # m; of the control points in the compact set
    drawn_in: tuple[float, ...] = (1.0, 0.3, 0.1)  # Towards the minimiser, of the points of the compact set
    same: float = 1e-3  # m and m/s^2; minimisers nearer than this are the same
    minima: int = 3  # Of Q, the best of which are where minimisations of Q_n begin
    clearly: float = 2e-3  # s; minima of Q_n that are found to be higher by more are not looked at closely


FIELD = FieldParameters()


@dataclass(frozen=True)
class Precision:
    """Stopping criterion of a minimisation: relative change of the value, and largest slope."""

    value: float
    gradient: float


FINE = Precision(1e-15, 1e-8)  # omega to about 1e-7
ROUGH = Precision(1e-6, 1e-4)  # the value to about 1e-4 s


class ZoneKind(StrEnum):
    """Kind of zones in Q_n."""

    ESTIMATE = "estimate"
    REGION = "region"


@dataclass(frozen=True)
class Metric:
    """A distance that the study measures."""

    name: str
    label: str
    exponent: float = -0.5  # Of n, by the theory
    of_minimiser: bool = True


METRICS = (
    Metric("sup_difference", "sup |Q_n - Q| (s)", of_minimiser=False),
    Metric("offsets", "distance of offsets (m)"),
    Metric("accelerations", "distance of accelerations (m/s²)"),
    Metric("path", "distance of paths (m)"),
    Metric("motion", "distance at the same time (m)"),
    Metric("travel_time", "difference of travel times (s)"),
    Metric("excess", "excess Q(ω_n) - Q(ω) (s)", -1.0),
)


@dataclass(frozen=True)
class ConsistencySettings:
    sizes: tuple[int, ...] = (10, 30, 100, 300, 1000, 3000, 10_000)  # Numbers n of observations
    noises: tuple[float, ...] = (0.01, 0.03, 0.1)  # Standard deviations of the errors of observations, m, on each axis
    repetitions: int = 20
    window: float = 10.0  # Time before the start in which all observations are made, s
    points: int = 128
    width: float = 0.05  # relative
    limit_width: float = 0.015
    zone_price: float = 20.0  # Prices of violations, s per m and s per unit of excess
    limit_price: float = 80.0  # Prices of violations, s per m and s per unit of excess
    fit_from: int = 30  # Slopes are fitted from this n on, or later: from where no minimiser lies in another basin
    seed: int = 0

    @classmethod
    def quick(cls, seed: int = 0) -> ConsistencySettings:
        """Return what shows the slopes roughly in a fraction of a minute."""
        return cls(sizes=(30, 300, 3000), noises=(0.01,), repetitions=8, points=64, seed=seed)

    @property
    def fingerprint(self) -> str:
        """Settings that results must share to be pooled: all but sizes, noises and repetitions."""
        keys = ("window", "points", "width", "limit_width", "zone_price", "limit_price", "seed")
        told = json.dumps([*(getattr(self, key) for key in keys), _obstacles(field_scenario()), asdict(PLANNER)])
        return sha256(told.encode()).hexdigest()[:16]


@dataclass(frozen=True, order=True)
class Replication:
    """One repetition."""

    noise: float
    size: int
    repetition: int


@dataclass(frozen=True)
class Record:
    """Measurements of one repetition."""

    task: Replication
    kind: ZoneKind
    values: dict[str, float]


def field_scenario() -> Scenario:
    """Return the field that the vehicle crosses, with the true motions."""
    with as_file(files(__package__) / "field.yaml") as path:
        return Scenario.load(path)


def _obstacles(scenario: Scenario) -> list[tuple[Vector, Vector, Vector, float]]:
    """Position m, velocity m/s and acceleration m/s^2 at the start time, and radius m, of each obstacle."""
    rows = []
    for obstacle in scenario.obstacles:
        motion, shape = obstacle.motion, obstacle.shape
        assert isinstance(motion, Motion) and isinstance(shape, Disc)
        rows.append((motion.position, motion.velocity, motion.acceleration, shape.disc))
    return rows


class Study:
    """The true objective, its minimisers and the compact set: what all repetitions share."""

    def __init__(self, settings: ConsistencySettings) -> None:
        self.settings = settings
        self.scenario = field_scenario()
        self.problem = build_problem(self.scenario, zones(self.scenario), PLANNER)
        self.truth = self.objective(self.problem)
        self.minima = self._minima()
        self.minimiser = self.minima[0]
        self.least = self.truth.evaluate(self.minimiser, gradient=False)

    def objective(self, problem: Problem) -> PenalisedObjective:
        """Return Q or Q_n: the one objective, on the problem's own samples."""
        settings = self.settings
        prices = uniform(problem, settings.zone_price, settings.limit_price)
        return PenalisedObjective(problem, prices, uniform(problem, settings.width, settings.limit_width))

    def minimise(self, objective: PenalisedObjective, omega: Array, precision: Precision = FINE) -> Array:
        """Return the local minimiser in the box of accelerations that L-BFGS-B finds from omega."""
        from scipy.optimize import minimize

        coordinates = Coordinates(self.problem, objective.trajectory(omega))
        bounds = list(zip(coordinates.lower, coordinates.upper, strict=True))

        def scaled(y: Array) -> tuple[float, Array]:
            found = objective.evaluate(coordinates.omega(y))
            return found.value, coordinates.slope(found.gradient)

        options = {"maxcor": 40, "maxfun": 1000, "maxiter": 1000, "ftol": precision.value, "gtol": precision.gradient}
        found = minimize(scaled, coordinates.origin, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        return coordinates.omega(found.x)

    def _minima(self) -> list[Array]:
        """The lowest different local minima of Q, from different ways round."""
        found = [self.minimise(self.truth, self.truth.omega(start)) for _, start in starts(self.problem, 12)]
        found.sort(key=self.truth.value)
        kept: list[Array] = []
        for omega in found:
            if all(np.abs(omega - other).max() > FIELD.same for other in kept):
                kept.append(omega)
        return kept[: FIELD.minima]

    @cached_property
    def compact_set(self) -> Array:
        """Points of the compact set, (P, K)."""
        from scipy.stats import qmc

        objective, limits = self.truth, self.problem.limits
        free = objective.path_size
        low = np.full(objective.size, -FIELD.largest_offset)
        high = np.full(objective.size, FIELD.largest_offset)
        low[free:], high[free:] = -limits.deceleration, limits.acceleration
        sequence = qmc.Halton(objective.size, scramble=False)
        points: list[Array] = []
        while len(points) < self.settings.points:
            for unit in sequence.random(256):
                omega = low + unit * (high - low)
                for share in FIELD.drawn_in:
                    drawn = self.minimiser + share * (omega - self.minimiser)
                    if self.in_domain(drawn):
                        points.append(drawn)
        return np.array(points[: self.settings.points])

    def in_domain(self, omega: Array) -> bool:
        """True if a trip arrives in time and never reverses."""
        trajectory = self.truth.trajectory(omega)
        return trajectory.travel_time <= FIELD.max_travel_time and bool(trajectory.speed_control_points().min() >= 0.0)

    @cached_property
    def sampled(self) -> tuple[Array, Array, Array]:
        """Times (P, N), positions (P, N, 2), and Q without its part from zones (P,), of the compact set."""
        table, objective, count = self.problem.samples, self.truth, self.problem.zones.size
        times, positions, rest = [], [], []
        for omega in self.compact_set:
            points = objective.trajectory(omega).at(table)
            found = objective.evaluate(omega, gradient=False)
            times.append(points.time)
            positions.append(points.path.position)
            rest.append(found.value - float(objective.prices[:count] @ found.violations[:count]))
        return np.array(times), np.array(positions), np.array(rest)

    def set_values(self, batch: ZoneBatch) -> Array:
        """Q at all points of the compact set with other zones, (P,)."""
        times, positions, rest = self.sampled
        excess = -batch.distances(times.ravel(), positions.reshape(-1, 2)).T
        violation, _ = soft_excess(excess.reshape(batch.size, *times.shape), self.truth.shares, self.settings.width)
        values: Array = rest + self.settings.zone_price * violation.sum(axis=0)
        return values

    @cached_property
    def true_values(self) -> Array:
        """Q at all points of the compact set, (P,)."""
        return self.set_values(self.problem.zones)

    def observed(self, task: Replication) -> Scenario:
        """Return the field with obstacles as they are observed in one repetition."""
        settings = self.settings
        random = np.random.default_rng([settings.seed, round(1e6 * task.noise), task.size, task.repetition])
        times = np.linspace(-settings.window, 0.0, task.size)
        obstacles = []
        for obstacle, (position, velocity, acceleration, _) in zip(
            self.scenario.obstacles, _obstacles(self.scenario), strict=True
        ):
            track = np.asarray(position) + np.outer(times, velocity) + np.outer(0.5 * times**2, acceleration)
            seen = track + task.noise * random.normal(size=track.shape)
            obstacles.append(
                {
                    "id": obstacle.id,
                    "shape": obstacle.shape,
                    "observations": {"time": times.tolist(), "position": seen.tolist(), "covariance": None},
                }
            )
        return Scenario.model_validate({**self.scenario.model_dump(by_alias=True), "obstacles": obstacles})

    def measure(self, task: Replication) -> list[Record]:
        """Do one repetition."""
        observed = self.observed(task)
        regions = zones(observed)
        kinds = {
            ZoneKind.ESTIMATE: tuple(replace(zone, covariances=None) for zone in regions),
            ZoneKind.REGION: regions,
        }
        inflation = self.scenario.vehicle.radius + PLANNER.clearance_margin
        batches = {kind: ZoneBatch.of(some, self.problem.frame, inflation) for kind, some in kinds.items()}
        return [Record(task, kind, self._measure(self.problem.among(batch))) for kind, batch in batches.items()]

    def _measure(self, problem: Problem) -> dict[str, float]:
        objective = self.objective(problem)
        omega = self._least_minimiser(objective)
        values = self.set_values(problem.zones)
        found, free = self.truth.evaluate(omega, gradient=False), objective.path_size
        trajectory, best = self.truth.trajectory(omega), self.truth.trajectory(self.minimiser)
        stations = np.linspace(0.0, 1.0, 201)
        path = trajectory.path.points(stations).offset - best.path.points(stations).offset
        return {
            "sup_difference": float(np.abs(values - self.true_values).max()),
            "offsets": float(np.linalg.norm((omega - self.minimiser)[:free])),
            "accelerations": float(np.linalg.norm((omega - self.minimiser)[free:])),
            "path": float(np.abs(path).max()),
            "motion": self._distance_in_time(omega),
            "travel_time": abs(found.travel_time - self.least.travel_time),
            "excess": found.value - self.least.value,
            "other_way": float(self._is_another_way(omega)),
            "least_speed": float(trajectory.speed_control_points().min()),
            "lower_points": float(np.sum(values < objective.value(omega) - 1e-9)),
        }

    def _least_minimiser(self, objective: PenalisedObjective) -> Array:
        """Return the lowest minimiser that is found from the true minima; those that are clearly higher stay rough."""
        rough = [self.minimise(objective, omega, ROUGH) for omega in self.minima]
        values = [objective.value(omega) for omega in rough]
        fine = [
            self.minimise(objective, omega)
            for omega, value in zip(rough, values, strict=True)
            if value < min(values) + FIELD.clearly
        ]
        return min(fine, key=objective.value)

    def _is_another_way(self, omega: Array) -> bool:
        """True if descent of the true objective leads elsewhere than to its minimiser."""
        rough = self.minimise(self.truth, omega, ROUGH)
        if np.abs(rough - self.minimiser).max() <= FIELD.same:
            return False
        return bool(np.abs(self.minimise(self.truth, rough) - self.minimiser).max() > FIELD.same)

    def _distance_in_time(self, omega: Array) -> float:
        """Largest distance at the same time between a trip and the true minimiser; who has arrived waits."""
        ends = [self.truth.trajectory(omega), self.truth.trajectory(self.minimiser)]
        times = np.linspace(0.0, max(trajectory.travel_time for trajectory in ends), 301)
        first, second = (
            trajectory.at(self.problem.space.time_table(np.minimum(times / trajectory.travel_time, 1.0))).path.position
            for trajectory in ends
        )
        return float(np.linalg.norm(first - second, axis=1).max())


@dataclass(frozen=True)
class BorderPoint:
    """The objective near the border of D0(v0): straight trips at a constant acceleration just above the least one."""

    start_speed: float  # v0, m/s
    distance: float  # m/s^2
    travel_time: float  # s
    final_speed: float  # m/s
    value: float  # Q, s; infinite at negative distances
    slope: float  # d tau / d acceleration, s/(m/s^2)


def border(start_speeds: Sequence[float] = (1.0, 0.0)) -> list[BorderPoint]:
    """Approach the border of the domain."""
    rows = []
    scenario = field_scenario()
    for start_speed in start_speeds:
        start = scenario.start.model_copy(update={"speed": start_speed})
        moved = scenario.model_copy(update={"start": start})
        problem = build_problem(moved, zones(moved), PLANNER)
        free = uniform(problem, 0.0, 0.0)
        objective = PenalisedObjective(problem, uniform(problem, 20.0, 20.0), uniform(problem, 0.05, 0.015))
        timed = PenalisedObjective(problem, free, free)
        least = -(start_speed**2) / (2.0 * problem.space.length)
        for distance in (*(10.0**-power for power in range(0, 11)), -1e-9):
            omega = np.zeros(objective.size)
            omega[objective.path_size :] = least + distance
            found = objective.evaluate(omega, gradient=False)
            finite = np.isfinite(found.value)
            slope = float(timed.gradient(omega)[objective.path_size :].sum()) if finite else np.nan
            final = objective.trajectory(omega).final_speed if finite else np.nan
            rows.append(BorderPoint(start_speed, distance, found.travel_time, float(final), found.value, slope))
    return rows
