"""Rules of a scenario; each looks at one part and yields its faults."""

from __future__ import annotations

import functools
import itertools
import logging
import math
from collections.abc import Iterator
from typing import Any

from scp_planner.errors import MISSING
from scp_planner.mathematics import corridor, planar
from scp_planner.scenario.obstacle_checks import headings_turn_slowly, one_position_a_time, times_increase
from scp_planner.scenario.scale import units_of
from scp_planner.scenario.tolerances import SAME_PLACE
from scp_planner.scenario.validation import Objection, Unknown

logger = logging.getLogger(__name__)


AXES = ("x", "y")


def start_speed_is_allowed(scenario: Any) -> Iterator[Objection]:
    """The start's speed is within the vehicle's limit."""
    yield from speed_is_within("start", scenario.start.speed, scenario.vehicle.max_speed)


def discs_have_a_reference(vehicle: Any) -> Iterator[Objection]:
    """One disc is where the point is that follows the path, and none is given twice."""
    if 0.0 not in vehicle.discs:
        yield Objection(("discs",), vehicle.discs, "must have one entry that is 0, the point that follows the path")
    for i, offset in enumerate(vehicle.discs):
        if offset in vehicle.discs[:i]:
            yield Objection(("discs", i), offset, "must differ from the entries before it")


def long_vehicles_steer_ahead(vehicle: Any) -> Iterator[Objection]:
    """Only vehicles that sweep no more than they cover turn on the spot."""
    if len(vehicle.discs) > 1 and vehicle.steering != "ahead":
        yield Objection(("steering",), vehicle.steering, "must be ahead for a vehicle of more than one disc")


def backwards_is_no_faster(vehicle: Any) -> Iterator[Objection]:
    """Driving backwards is no faster than ahead, so that bounds of the travel time hold for both."""
    for name in ("max_speed", "max_acceleration"):
        value = None if vehicle.reverse is None else getattr(vehicle.reverse, name)
        if value is not None and value > getattr(vehicle, name):
            text = f"must be at most vehicle.{name}, {getattr(vehicle, name):g}"
            yield Objection(("reverse", name), value, text)


def turns_on_the_spot(vehicle: Any) -> Iterator[Objection]:
    """A rate of turns on the spot is given for a vehicle that can make them."""
    if vehicle.max_turn_rate is not None and vehicle.steering not in ("on_the_spot", "any"):
        text = f"only for a vehicle whose steering is on_the_spot or any, not {vehicle.steering}"
        yield Objection(("max_turn_rate",), vehicle.max_turn_rate, text)


def start_acceleration_is_allowed(scenario: Any) -> Iterator[Objection]:
    """The start's acceleration is within the vehicle's limits."""
    value, vehicle = scenario.start.acceleration, scenario.vehicle
    if value is not None and not -vehicle.max_deceleration <= value <= vehicle.max_acceleration:
        allowed = f"[{-vehicle.max_deceleration:g}, {vehicle.max_acceleration:g}]"
        yield Objection(("start", "acceleration"), value, f"must be in {allowed}, the vehicle's limits in m/s2")


def heading_is_in_radians(end: Any) -> Iterator[Objection]:
    """A heading of several turns is a legal one, but hardly meant: say so."""
    if end.heading is not None and abs(end.heading) > 4.0 * math.pi:
        logger.warning(
            "heading = %g rad is more than two turns, and almost certainly degrees; %g degrees are %.4f rad",
            end.heading,
            end.heading,
            math.radians(end.heading),
        )
    yield from ()


def box_is_not_empty(bounds: Any) -> Iterator[Objection]:
    """The upper corner lies above and to the right of the lower one."""
    for i, axis in enumerate(AXES):
        if bounds.max[i] <= bounds.min[i]:
            yield Objection(("max", i), bounds.max[i], f"must be greater than min, whose {axis} is {bounds.min[i]:g}")


def ends_are_in_bounds(scenario: Any) -> Iterator[Objection]:
    """The vehicle's disc lies in the bounds at the start, and at a goal that stands."""
    for place in ("start", "goal") if scenario.goal.target is None else ("start",):
        yield from _in_bounds(place, scenario)


def guide_begins_at_start(scenario: Any) -> Iterator[Objection]:
    """The first point of the guide is the start."""
    guide, start, goal = scenario.guide, scenario.start.position, scenario.goal.position
    if guide is not None and not same_place(guide[0], start, goal):
        yield Objection(("guide", 0), guide[0], f"must be start.position, {list(start)}")


def guide_leads_to_goal(scenario: Any) -> Iterator[Objection]:
    """The last point of the guide is the goal, and no point is repeated at once."""
    guide, start, goal = scenario.guide, scenario.start.position, scenario.goal.position
    if guide is not None and not same_place(guide[-1], goal, start):
        yield Objection(("guide", len(guide) - 1), guide[-1], f"must be goal.position, {list(goal)}")
    yield from _points_repeated("guide", guide)


def _points_repeated(key: str, line: Any) -> Iterator[Objection]:
    for i, (before, point) in enumerate(itertools.pairwise(line or ()), start=1):
        if same_place(before, point):
            yield Objection((key, i), point, "must differ from the point before it")


def corridor_is_of_convex_polygons(scenario: Any) -> Iterator[Objection]:
    """Each polygon of the corridor is simple and convex, and has not too many corners for what lies outside."""
    polygons = scenario.corridor or ()
    yield from _not_convex("corridor", polygons)
    for i, polygon in enumerate(polygons):
        if len(polygon) > corridor.SIZE.most_corners:
            text = f"must have at most {corridor.SIZE.most_corners} corners, not {len(polygon)}: leave some of them out"
            yield Objection(("corridor", i), polygon, text)


def _not_convex(key: str, polygons: Any) -> Iterator[Objection]:
    for i, polygon in enumerate(polygons):
        faults = list(polygon_faults(polygon, key, i))
        yield from faults
        if not faults and not planar.is_convex(polygon):
            yield Objection((key, i), polygon, "must be convex")


def corridor_leads_from_start_to_goal(scenario: Any) -> Iterator[Objection]:
    """From a polygon that holds the start one can get to one that holds the goal by those that overlap."""
    polygons = scenario.corridor
    if polygons is None or scenario.goal.target is not None or any(_is_no_cell(polygon) for polygon in polygons):
        return
    start, goal = scenario.start.position, scenario.goal.position
    reached = {i for i, polygon in enumerate(polygons) if planar.distance_to_polygon(start, polygon) == 0.0}
    for place, position in (("start", start), ("goal", goal)):
        if all(planar.distance_to_polygon(position, polygon) > 0.0 for polygon in polygons):
            yield Objection((place, "position"), position, "must be in the corridor")
            return
    reached = corridor.connected(polygons, reached)
    if all(planar.distance_to_polygon(goal, polygons[i]) > 0.0 for i in reached):
        text = "must have polygons that overlap from the one with start.position to the one with goal.position"
        yield Objection(("corridor",), polygons, text)


def ends_are_in_corridor(scenario: Any) -> Iterator[Objection]:
    """The vehicle's disc at start and goal lies in the corridor; at the goal anywhere within its radius."""
    polygons = scenario.corridor
    if polygons is None or any(_is_no_cell(polygon) for polygon in polygons):
        return
    if scenario.start.position == scenario.goal.position:
        return  # that is a fault of its own
    # In the units in which it is planned: then this is done.
    units, radius = units_of(scenario), scenario.vehicle.radius
    inside, begin = units.lines(polygons), units.place(scenario.start.position)
    corridor.known_outlines(inside, begin)
    if scenario.goal.target is None:
        corridor.known_way(inside, begin, units.place(scenario.goal.position))
    walls = corridor.known_outside(inside)
    ends = (("start", 0.0), ("goal", scenario.goal.radius))
    for place, reach in ends if scenario.goal.target is None else ends[:1]:
        position = getattr(scenario, place).position
        discs = _disc_centres(getattr(scenario, place), scenario)
        centres = [units.place(centre) for centre in discs]
        room = units.length * min(planar.distance_to_polygon(centre, wall) for wall in walls for centre in centres)
        in_it = any(planar.distance_to_polygon(position, polygon) == 0.0 for polygon in polygons)
        if in_it and room < radius - reach:
            text = f"must be at least {radius - reach:g} m from the border of the corridor; it is {room:.6g} m"
            yield Objection((place, "position"), position, text)


def corridor_has_its_name(scenario: Any) -> Iterator[Objection]:
    """No obstacle is called what the outside of the corridor, or the walls, are called."""
    taken = {
        corridor.NAME: "the corridor itself" if scenario.corridor is not None else "",
        corridor.WALLS: "the walls themselves" if scenario.walls else "",
    }
    for i, obstacle in enumerate(scenario.obstacles):
        name = _known(obstacle, "id")
        if taken.get(name):
            yield Objection(("obstacles", i, "id"), name, f"must not be {name!r}, which is {taken[name]}")


def walls_are_convex(scenario: Any) -> Iterator[Objection]:
    """Each wall is a simple and convex polygon."""
    yield from _not_convex("walls", scenario.walls)


def start_is_clear_of_walls(scenario: Any) -> Iterator[Objection]:
    """At the start no disc of the vehicle touches a wall."""
    start, radius = scenario.start, scenario.vehicle.radius
    discs = _disc_centres(start, scenario)
    for i, polygon in enumerate(scenario.walls):
        room = min(planar.distance_to_polygon(centre, polygon) for centre in discs)
        if room < radius:
            text = f"must be at least {radius:g} m, the radius, from walls[{i}]; it is {room:.6g} m"
            yield Objection(("start", "position"), start.position, text)


def ends_are_clear_of_cells(scenario: Any) -> Iterator[Objection]:
    """At the start no disc touches an occupied cell, nor at the goal, unless it may lie elsewhere."""
    if scenario.ground is None:
        return
    if scenario.corridor is not None:
        yield Objection(("corridor",), scenario.corridor, "must be null beside a map of the ground")
    radius = scenario.vehicle.radius
    fixed = scenario.goal.radius == 0.0 and scenario.goal.region is None and scenario.goal.target is None
    for place in ("start", "goal") if fixed else ("start",):
        room = room_on_map(scenario, getattr(scenario, place))
        if room < radius:
            text = f"must be at least {radius:g} m, the radius, from occupied cells of the map; it is {room:.6g} m"
            yield Objection((place, "position"), getattr(scenario, place).position, text)


def room_on_map(scenario: Any, place: Any) -> float:
    """Distance of the discs' centres at start or goal from occupied cells, m; if none touches one, any more."""
    if scenario.ground is None:
        return math.inf
    return min(scenario.ground.map.distance(one, scenario.vehicle.radius) for one in _disc_centres(place, scenario))


def stretch_is_not_empty(limit: Any) -> Iterator[Objection]:
    """A stretch ends behind its beginning."""
    if limit.to is not None and limit.to <= limit.from_:
        yield Objection(("to",), limit.to, f"must be greater than from, {limit.from_:g}")


def line_moves_on(limit: Any) -> Iterator[Objection]:
    """No point of a line is repeated at once."""
    yield from _points_repeated("line", limit.line)


def stretches_begin_on_their_lines(scenario: Any) -> Iterator[Objection]:
    """A stretch begins before its line ends."""
    for i, limit in enumerate(scenario.speed_limits):
        first, line = _known(limit, "from_"), _line_of(limit, scenario)
        if first is None or line is None:
            continue
        length = sum(math.dist(p, q) for p, q in itertools.pairwise(line))
        if first >= length:
            yield Objection(
                ("speed_limits", i, "from"), first, f"must be less than {length:g} m, the length of its line"
            )


def speeds_keep_to_places(scenario: Any) -> Iterator[Objection]:
    """The speeds at start and goal are within the limits there."""
    for i, limit in enumerate(scenario.speed_limits):
        first, top, line = _known(limit, "from_"), _known(limit, "speed"), _line_of(limit, scenario)
        if first is None or top is None or line is None:
            continue
        last = math.inf if limit.to is None else limit.to
        for place in ("start", "goal"):
            end = getattr(scenario, place)
            if end.speed is not None and end.speed > top and first <= planar.station(end.position, line) <= last:
                text = f"must be at most {top:g} m/s, the limit of speed_limits[{i}] there"
                yield Objection((place, "speed"), end.speed, text)


def ids_are_unique(scenario: Any) -> Iterator[Objection]:
    """No two obstacles have the same id."""
    first: dict[str, int] = {}
    for i, obstacle in enumerate(scenario.obstacles):
        name = _known(obstacle, "id")
        if name is not None and first.setdefault(name, i) != i:
            yield Objection(("obstacles", i, "id"), name, f"must be unique; obstacles[{first[name]}] has it too")


def start_is_free(scenario: Any) -> Iterator[Objection]:
    """At the start's time no disc of the vehicle touches an obstacle whose place then is known exactly."""
    radius, start = scenario.vehicle.radius, scenario.start
    discs = _disc_centres(start, scenario)
    for i, obstacle in enumerate(scenario.obstacles):
        motion, shape = _known(obstacle, "motion"), _known(obstacle, "shape")
        if shape is None or not _is_exact(motion):
            continue  # observed, or faulty, or a prediction
        try:
            on_course = _known(motion, "velocity") is None
            seen_from = functools.partial(_from_course, _length(shape)) if on_course else _from_centre
            distance = min(shape.distance(*seen_from(centre, motion, start.time)) for centre in discs)
        except Unknown:
            continue
        if distance < radius:
            name = _known(obstacle, "id")
            which = f"obstacles[{i}]" if name is None else f"obstacles[{i}] ({name:.40})"
            text = f"must be at least {radius:g} m, the radius, from {which}; it is {distance:.6g} m"
            yield Objection(("start", "position"), start.position, text)


def _is_exact(motion: Any) -> bool:
    """True if a motion is given that is known exactly."""
    return motion is not None and all(_known(motion, key) is None for key in ("covariance", "futures"))


def observations_are_past(scenario: Any) -> Iterator[Objection]:
    """Nothing has been observed after the start, and no tracker's estimate is of later."""
    start = scenario.start.time
    for i, obstacle in enumerate(scenario.obstacles):
        time = _known(obstacle, "estimate", "time")
        if time is not None and time > start + _rounding_of((time,)):
            yield Objection(
                ("obstacles", i, "estimate", "time"), time, f"must not be later than start.time, {start:g} s"
            )
        times = _known(obstacle, "observations", "time") or ()
        latest = start + _rounding_of(times)
        late = next((k for k, time in enumerate(times) if time > latest), None)
        if late is not None:
            path = ("obstacles", i, "observations", "time", late)
            yield Objection(path, times[late], f"must not be later than start.time, {start:g} s")


def _rounding_of(times: Any) -> float:
    """Give by how much times may miss what was meant, s: sums of steps do, by the clock's digits or by theirs."""
    step = min((after - before for before, after in itertools.pairwise(times) if after > before), default=0.0)
    return SAME_PLACE * step + 4.0 * max((math.ulp(time) for time in (*times[:1], *times[-1:])), default=0.0)


def polygon_is_simple(shape: Any) -> Iterator[Objection]:
    """The polygon's edges bound one area and meet only at its vertices."""
    yield from polygon_faults(shape.polygon, "polygon")


def _is_no_cell(polygon: Any) -> bool:
    crowded = len(polygon) > corridor.SIZE.most_corners
    return crowded or any(polygon_faults(polygon)) or not planar.is_convex(polygon)


def polygon_faults(vertices: Any, *place: str | int) -> Iterator[Objection]:
    """Yield what is wrong with a polygon, at a place below the part, that is to bound one area."""
    repeated = [i for i, vertex in enumerate(vertices) if vertex == vertices[i - 1]]
    for i in repeated:
        yield Objection((*place, i), vertices[i], "must differ from the vertex before it")
    if repeated:
        return
    extent = max(math.dist(vertices[0], vertex) for vertex in vertices)
    if abs(planar.area(vertices)) <= SAME_PLACE * extent**2:
        yield Objection(place, vertices, "must have an area greater than 0")
    elif crossing := planar.first_crossing(vertices):
        text = f"must not cross or touch itself; the edges after vertices {crossing[0]} and {crossing[1]} do"
        yield Objection(place, vertices, text)


def speed_is_within(place: str, speed: float, limit: float) -> Iterator[Objection]:
    """Object to a speed at the start or the goal that is above the vehicle's limit, both in m/s."""
    if speed > limit:
        yield Objection((place, "speed"), speed, f"must be at most vehicle.max_speed, {limit:g} m/s")


def _in_bounds(place: str, scenario: Any) -> Iterator[Objection]:
    if scenario.bounds is None:
        return
    position, radius = getattr(scenario, place).position, scenario.vehicle.radius
    discs = _disc_centres(getattr(scenario, place), scenario)
    for i, axis in enumerate(AXES):
        low = scenario.bounds.min[i] + radius - min(centre[i] - position[i] for centre in discs)
        high = scenario.bounds.max[i] - radius - max(centre[i] - position[i] for centre in discs)
        is_box = scenario.bounds.min[i] < scenario.bounds.max[i]  # else that is the fault
        if is_box and not low <= position[i] <= high:
            text = f"must have its {axis} in [{low:g}, {high:g}]: the vehicle's disc stays inside the bounds"
            yield Objection((place, "position"), position, text)


def ahead_of(end: Any, distance: float) -> planar.Point:
    """The point so far ahead of the start or the goal; the place itself where the heading is not known."""
    x, y = end.position
    if end.heading is None:
        return (x, y)
    return (x + distance * math.cos(end.heading), y + distance * math.sin(end.heading))


def _disc_centres(end: Any, scenario: Any) -> list[planar.Point]:
    """Centres of the vehicle's discs at the start or the goal, as far as the heading there is known."""
    if end.heading is None:
        return [end.position]
    c, s = math.cos(end.heading), math.sin(end.heading)
    return [(end.position[0] + offset * c, end.position[1] + offset * s) for offset in scenario.vehicle.discs]


def same_place(p: planar.Point, q: planar.Point, *others: planar.Point) -> bool:
    """True if two points are one to rounding: that of their coordinates, and of those of others that they are among."""
    return math.dist(p, q) <= SAME_PLACE * max(abs(value) for point in (p, q, *others) for value in point)


def _line_of(limit: Any, scenario: Any) -> Any:
    """The line that a speed limit is along; None if it is faulty."""
    own = vars(limit).get("line", MISSING)
    if own is MISSING:
        return None
    return own or scenario.guide or (scenario.start.position, scenario.goal.position)


def _known(part: Any, *names: str) -> Any:
    """Walk down to a field; None if it is null or faulty or lies in something that is."""
    for name in names:
        part = None if part is None else vars(part).get(name)
    return part


def _from_centre(point: planar.Point, motion: Any, time: float) -> tuple[planar.Point, float]:
    """Express a point relative to a moving obstacle's centre, and give the obstacle's heading in rad."""
    time = 0.0 if motion.time is None else time - motion.time  # without a time it holds at the start
    x, y = (
        p - (c + v * time + 0.5 * a * time**2)
        for p, c, v, a in zip(point, motion.position, motion.velocity, motion.acceleration, strict=True)
    )
    vx, vy = (v + a * time for v, a in zip(motion.velocity, motion.acceleration, strict=True))
    if vx == vy == 0.0:
        vx, vy = motion.acceleration  # what sets off will head there
    return (x, y), math.atan2(vy, vx)


def _length(shape: Any) -> float:
    """Length of a shape that heads along its motion, m; 0 for others."""
    if hasattr(shape, "rectangle"):
        return math.hypot(*shape.rectangle)
    return 2.0 * max(shape.ellipse) if hasattr(shape, "ellipse") else 0.0


def _from_course(length: float, point: planar.Point, course: Any, time: float) -> tuple[planar.Point, float]:
    """Express a point relative to the centre of a shape of a length on a course, and give its heading in rad."""
    import numpy as np

    from scp_planner.mathematics.courses import course_polynomials

    if any(times_increase(course)) or any(one_position_a_time(course)):
        raise Unknown("time")
    centre, now = course_polynomials(course.time, course.position), np.array([time])
    if length == 0.0:
        pointing = centre  # it is the same in all directions, or does not turn
    elif course.heading is not None:
        if any(headings_turn_slowly(course)):
            raise Unknown("heading")
        from scp_planner.mathematics.courses import course_pointing

        pointing = course_pointing(course.time, course.heading)
    else:
        from scp_planner.mathematics.headings import course_heading

        pointing = course_heading(centre, length) or centre
    (x, y), (vx, vy) = centre.grid(now)[0, 0].tolist(), pointing.derivative.grid(now)[0, 0].tolist()
    return (point[0] - x, point[1] - y), math.atan2(vy, vx)
