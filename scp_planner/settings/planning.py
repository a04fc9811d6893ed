"""Settings of the planner: all knobs in one frozen place, with defaults that need no tuning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any, TypeVar

from scp_planner.errors import Fault, SettingsError
from scp_planner.settings.knobs import Above, Choice, Knob, Knobs, Range, knobs
from scp_planner.units import Units

LARGEST = 1e12  # in any unit, of a setting
LONGEST_SPAN = 1000.0  # units of length


def solver_names() -> tuple[str, ...]:
    """Give the names of the solvers, those of users included."""
    from scp_planner.solvers.interface import SOLVERS

    return tuple(SOLVERS)


@dataclass(frozen=True)
class Settings(Knobs):
    """Settings of :func:`scp_planner.plan`.

    Every value has a range; see the reference of the settings, or ``scp-planner settings``. Lengths and times that are
    ``none`` are decided by the scene: they are ratios to its units of length, a twentieth of the trip, and of time, in
    which the vehicle drives three units of length at the highest speed that it can reach on the trip. The scene also
    says how small or large one that is given may be.

    Attributes
    ----------
    solver : str
        Solver of the subproblem. All give the same plan; ``daqp`` is the fastest, ``cvxpy`` the one to read and extend.
    path_degree : int
        Degree of the offset's B-spline. Higher: smoother curvature, and wider turns between obstacles.
    path_span : float or None
        Desired length of a span of the offset's B-spline. Smaller: tighter curves fit, and every step takes longer.
        Spans are longer where there would be more than ``max_path_spans``, and are refined where the trip curves
        within them. None: 1.5 units, and less among many obstacles that are far smaller than that.
    max_path_spans : int
        Spans over a straight guide, at most. More: narrower gaps fit on long trips, and every step takes longer.
    acceleration_degree : int
        Degree of the acceleration's B-spline. 0, piecewise constant, is the fastest trip; from 1 on the acceleration
        has no jumps.
    acceleration_spans : int
        Number of equal spans of the acceleration in normalised time; switching times of the trip without
        obstacles are added as breakpoints. More: finer changes of speed, and every step takes longer.
    samples : int
        Times at which constraints are sampled; minima between them are refined. More: fewer repeats for violations
        between samples, and every step takes longer.
    clearance_margin : float or None
        Planned clearance beyond every zone, which absorbs linearisation errors. Larger: plans are certified at once
        more often, and pass obstacles at a larger distance. None: 0.001 units.
    limit_margin : float
        Relative distance kept from every limit of the vehicle. Larger: slower trips, and plans that are certified at
        once more often.
    box_margin : float or None
        Planned distance to the sides of the workspace box. None: 0.005 units.
    max_offset : float or None
        Largest offset of the path from the guide. Larger: wider detours are searched. None: 8 units.
    effort : float
        Factor of ``searches`` and ``max_runs``. From 2 on finer grids are searched as well, unless it is proved first
        that no trip is notably faster; the plan then has the bound among the obstacles. Larger: slower, up to that
        factor, and better odds of the fastest homotopy class. With a time limit the search continues until then, or
        until no candidate is left that may be faster.
    searches : int
        Sweeps of the search for homotopy classes, at most. More: better odds of the best one among many obstacles.
    max_runs : int
        Starts of the loop, at most. More: slower, and better odds of the best homotopy class.
    max_iterations : int
        Iterations of one run of the loop, at most.
    tolerance : float or None
        A run has converged when a step promises less than this. Smaller: more iterations for the last bit. None: 0.0003
        units of time.
    """

    solver: Annotated[str, Choice(solver_names)] = "daqp"
    path_degree: Annotated[int, Range(3, 5)] = 3
    path_span: Annotated[float | None, Above(0.0, LARGEST, "m")] = None
    max_path_spans: Annotated[int, Range(4, 5000)] = 100
    acceleration_degree: Annotated[int, Range(0, 2)] = 0
    acceleration_spans: Annotated[int, Range(1, 200)] = 20
    samples: Annotated[int, Range(10, 5000)] = 160
    clearance_margin: Annotated[float | None, Range(0.0, LARGEST, "m")] = None
    limit_margin: Annotated[float, Range(0.0, 0.5)] = 1e-4
    box_margin: Annotated[float | None, Range(0.0, LARGEST, "m")] = None
    max_offset: Annotated[float | None, Above(0.0, LARGEST, "m")] = None
    effort: Annotated[float, Range(0.05, 1000.0)] = 1.0
    searches: Annotated[int, Range(1, 1000)] = 24
    max_runs: Annotated[int, Range(1, 1000)] = 8
    max_iterations: Annotated[int, Range(1, 1000)] = 60
    tolerance: Annotated[float | None, Above(0.0, LARGEST, "s")] = None


@dataclass(frozen=True)
class SceneSettings(Settings):
    """:class:`Settings` with nothing left open, lengths and times in the units of a scene."""

    path_span: Annotated[float, Range(0.1, LONGEST_SPAN)] = 1.5
    clearance_margin: Annotated[float, Range(0.0, 10.0)] = 1e-3
    box_margin: Annotated[float, Range(0.0, 10.0)] = 5e-3
    max_offset: Annotated[float, Range(0.01, 1000.0)] = 8.0
    tolerance: Annotated[float, Range(1e-8, 1.0)] = 3e-4


WALL_TIMES = frozenset({"reserve"})
"""Settings that are times of the computer's clock, of which the scene decides nothing."""

AnyKnobs = TypeVar("AnyKnobs", bound=Knobs)


def for_scene(settings: Settings, units: Units | None = None) -> SceneSettings:
    """Return the settings for a scene: what they leave open as the scene decides."""
    if isinstance(settings, SceneSettings):
        return settings
    return _for_scene(of_kind(settings, Settings), units or Units())


@lru_cache(maxsize=16)
def _for_scene(settings: Settings, units: Units) -> SceneSettings:
    return decided(settings, Settings, SceneSettings, units)


def with_given(settings: SceneSettings, given: Mapping[str, Any], units: Units) -> SceneSettings:
    """Return settings for a scene with some that a user gives, lengths in m and times in s, in their place."""
    usual = for_scene(Settings(**given), units)
    return replace(settings, **{name: getattr(usual, name) for name, value in given.items() if value is not None})


def of_kind(settings: object, kind: type[AnyKnobs]) -> AnyKnobs:
    """Return settings as they are if they are of the kind that is asked for."""
    if isinstance(settings, kind):
        return settings
    raise SettingsError("settings", [Fault("kind", type(settings).__name__, f"must be {kind.__name__}")])


def decided(settings: Knobs, kind: type[Knobs], scene: type[AnyKnobs], units: Units) -> AnyKnobs:
    """Return settings of one kind as those for a scene."""
    if isinstance(settings, scene):
        return settings
    of_kind(settings, kind)
    factors = {name: 1.0 if name in WALL_TIMES else units.factor(knob.unit) for name, knob in knobs(kind).items()}
    given = {name: value for name in factors if (value := getattr(settings, name)) is not None}
    values = {name: value / factors[name] if knobs(kind)[name].unit else value for name, value in given.items()}
    try:
        return scene(**values)
    except SettingsError as error:
        faults = [
            Fault(
                fault.path,
                given[fault.path],
                _in_this_scene(knobs(scene)[fault.path], knobs(kind)[fault.path], factors),
            )
            for fault in error.faults
        ]
        raise SettingsError("settings", faults) from None


def _in_this_scene(knob: Knob, users: Knob, factors: dict[str, float]) -> str:
    allowed, factor = knob.allowed, factors[knob.name]
    assert isinstance(allowed, Range), "only lengths and times depend on the scene"
    return f"must be {allowed.least * factor:.3g} to {allowed.most * factor:.3g} {users.unit} in this scene"
