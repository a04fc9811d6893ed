"""Roads of CommonRoad: routes over lanes, lines along them, and what lies beside the road."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import TooLargeError
from scp_planner.mathematics.polylines import lengths_along, points_at

Point = tuple[float, float]


@dataclass(frozen=True)
class RoadParameters:
    # m of the file, between points of the guide, which would else show the kinks of the centre lines
    guide_step: float = 3.0
    most_points: int = 30_000  # Of a line in equal steps
    change_cost: float = 30.0  # m of the file: of way that a change of lanes is worth
    change_margin: float = 0.2  # Part of a lane, before and after a change, in which the guide keeps to it
    wrong_way: float = 0.5 * math.pi  # rad; a lane that leads elsewhere by more than this is not where the vehicle is
    drawn_in: float = 0.015  # Widths of the vehicle by which borders are drawn in, and corners cut off on the way
    gap: float = 0.1  # Widths of the vehicle; narrower gaps between lanes are filled: no vehicle notices them
    # m, the file's precision: the official checker notices wider gaps between lanes not side by side
    seen_gap: float = 1e-6
    # Widths of the vehicle, of a wall; half as much, again and again, where something is in its way
    thickness: float = 1.5
    # rad, of the border along one wall: where it turns to the right what lies beside is convex
    most_turn: float = 0.5 * math.pi
    halvings: int = 10  # Of that thickness, at most
    shortest: float = 1e-3  # Widths of the vehicle; shorter edges of borders are none


ROADS = RoadParameters()


@dataclass(frozen=True)
class Route:
    """Lanes to drive along, one after the other or beside the other."""

    lanes: tuple[Any, ...]  # lanelets of commonroad-io

    def line(self, start: Point, goal: Point | None = None) -> Array:
        """Lay a line along the lanes' centres from beside the start to beside the goal, or their end, (k, 2) m."""
        rows = list(_rows(self.lanes))
        begin = _station(self.lanes[0], start)
        end = 1.0 if goal is None else _station(self.lanes[-1], goal)
        points: list[Array] = []
        for k, row in enumerate(rows):
            first, last = begin if k == 0 else 0.0, end if k == len(rows) - 1 else 1.0
            if last > first:
                points += _along(row, first, last)
        return np.array(points).reshape(-1, 2)

    def beyond(self, goal: Point) -> Array:
        """The rest of the last lane's centre from beside the goal on, (k, 2) m."""
        first = _station(self.lanes[-1], goal)
        return np.array(_along(self.lanes[-1:], first, 1.0)).reshape(-1, 2) if first < 1.0 else np.zeros((0, 2))


def route_to(network: Any, start: Point, heading: float, places: Sequence[Any]) -> Route | None:
    """Find the shortest way along lanes, and changes between them, to one of some polygons; None if there is none."""
    lanes = {lane.lanelet_id: lane for lane in network.lanelets}
    held: set[int] = set()
    for place in places:
        middle = place.representative_point()
        (at_goal,) = network.find_lanelet_by_position([np.array([middle.x, middle.y])])
        held |= set(at_goal) or {key for key, lane in lanes.items() if lane.polygon.shapely_object.intersects(place)}
    ways = _ways(network, lanes, start, heading)
    return next((Route(tuple(lanes[key] for key in way)) for way, _ in ways if way[-1] in held), None)


def route_ahead(network: Any, start: Point, heading: float, length: float) -> Route | None:
    """Return a way along lanes at least so long, m, with few changes, or as far as lanes lead; None off lanes."""
    lanes = {lane.lanelet_id: lane for lane in network.lanelets}
    longest, found = -math.inf, tuple[int, ...]()
    for way, end in _ways(network, lanes, start, heading):
        if end > longest:
            longest, found = end, way
        if longest >= length:
            break
    return Route(tuple(lanes[key] for key in found)) if found else None


def _ways(network: Any, lanes: dict[int, Any], start: Point, heading: float) -> Iterator[tuple[tuple[int, ...], float]]:
    """Shortest ways to all lanes, the nearest first, and how far from the start their last lanes end, m."""
    first = _lanes_at(network, lanes, start, heading)
    queue: list[tuple[float, float, int, tuple[int, ...]]] = [
        (0.0, -_station(lanes[key], start) * _length(lanes[key]), key, (key,)) for key in first
    ]
    heapq.heapify(queue)
    done: set[int] = set()
    while queue:
        cost, passed, key, way = heapq.heappop(queue)
        if key in done:
            continue
        done.add(key)
        length = _length(lanes[key])
        yield way, passed + length
        steps = [(cost + length, passed + length, each) for each in lanes[key].successor]
        steps += [(cost + ROADS.change_cost, passed, each) for each in _neighbours(lanes[key])]
        for more, at, each in steps:
            if each in lanes and each not in done:
                heapq.heappush(queue, (more, at, each, (*way, each)))


def _lanes_at(network: Any, lanes: dict[int, Any], start: Point, heading: float) -> list[int]:
    """Lanes that hold a place and lead about where the vehicle heads, those best in line first."""
    (here,) = network.find_lanelet_by_position([np.array(start, dtype=float)])
    turns = {key: abs(math.remainder(_heading(lanes[key], start) - heading, 2.0 * math.pi)) for key in here}
    return sorted((key for key in here if turns[key] <= ROADS.wrong_way), key=lambda key: (turns[key], key))


def _heading(lane: Any, point: Point) -> float:
    """Direction of a lane beside a point, rad."""
    line, stations = _measured(lane)
    at = int(np.clip(np.searchsorted(stations, _station(lane, point) * stations[-1]), 1, len(line) - 1))
    leg = line[at] - line[at - 1]
    return math.atan2(leg[1], leg[0])


def _neighbours(lane: Any) -> Iterator[int]:
    if lane.adj_left is not None and lane.adj_left_same_direction:
        yield lane.adj_left
    if lane.adj_right is not None and lane.adj_right_same_direction:
        yield lane.adj_right


def _rows(lanes: Sequence[Any]) -> Iterator[list[Any]]:
    """Lanes side by side that are changed between, in order."""
    row = [lanes[0]]
    for lane in lanes[1:]:
        if lane.lanelet_id in row[-1].successor:
            yield row
            row = []
        row.append(lane)
    yield row


def _along(row: Sequence[Any], first: float, last: float) -> list[Array]:
    """Points along lanes that are changed between from one part of their length to another."""
    share = (last - first) / len(row)
    points: list[Array] = []
    for k, lane in enumerate(row):
        low = first + share * (k + (ROADS.change_margin if k else 0.0))
        high = first + share * (k + 1.0 - (ROADS.change_margin if k < len(row) - 1 else 0.0))
        line, stations = _measured(lane)
        count = max(2, steps_in((high - low) * stations[-1], ROADS.guide_step) + 1)
        points += list(points_at(np.linspace(low, high, count) * stations[-1], stations, line))
    return points


def _station(lane: Any, point: Sequence[float]) -> float:
    """Part of a lane's length at which a point lies beside it."""
    line, stations = _measured(lane)
    fine = np.linspace(0.0, stations[-1], 400)
    nearest = int(np.linalg.norm(points_at(fine, stations, line) - np.asarray(point, dtype=float), axis=1).argmin())
    return float(fine[nearest] / stations[-1])


def _measured(lane: Any) -> tuple[Array, Array]:
    line = np.asarray(lane.center_vertices, dtype=float)
    return line, lengths_along(line)


def _length(lane: Any) -> float:
    return float(_measured(lane)[1][-1])


def steps_in(length: float, step: float) -> int:
    """Number of steps in a length, m; TooLargeError where there are too many of them."""
    if length > ROADS.most_points * step:
        text = f"must be at most {ROADS.most_points * step:g} m, not {length:g} m"
        raise TooLargeError(f"a way along lanes, and what the vehicle looks ahead at its speed, {text}")
    return math.ceil(length / step)


def spaced(points: Array, step: float) -> Array:
    """Return points at equal distances, about so large, along a polyline (k, 2), ends included, m."""
    stations = lengths_along(points)
    wanted = np.linspace(0.0, stations[-1], max(2, steps_in(stations[-1], step)) + 1)
    placed = points_at(wanted, stations, points)
    placed[0], placed[-1] = points[0], points[-1]
    return placed


def drivable(network: Any, line: Array, reach: float, width: float, gap: float) -> Any:
    """Return the part of the road that lies around a line, as a polygon of shapely, its borders drawn in a little."""
    around, inwards = _about(line, reach), ROADS.drawn_in * width
    return road_in(network, around, gap, inwards).simplify(inwards).intersection(around.simplify(inwards))


def road_in(network: Any, around: Any, gap: float, inwards: float = 0.0) -> Any:
    """Return the road about an area: the lanes that meet it, those side by side as one, and narrow gaps filled."""
    from shapely import Polygon, make_valid, union_all

    polygons = [Polygon(outline) for outline in _outlines({lane.lanelet_id: lane for lane in network.lanelets})]
    near = [make_valid(polygon) for polygon in polygons if polygon.envelope.intersects(around)]
    fill = 0.5 * gap
    return union_all(near).buffer(fill, join_style="mitre").buffer(-fill - inwards, join_style="mitre")


def _outlines(lanes: dict[int, Any]) -> Iterator[Array]:
    """Outlines of lanes side by side, (k, 2) m: the outermost borders, joined by lines over the ends of the others."""
    done: set[int] = set()
    for first in lanes:
        if first in done:
            continue
        row = [(first, True)]
        for leftwards in (False, True):
            key, same = first, True
            while True:
                lane, on_left = lanes[key], leftwards == same
                key = lane.adj_left if on_left else lane.adj_right
                if key not in lanes or any(key == each for each, _ in row):
                    break
                same = same == bool(lane.adj_left_same_direction if on_left else lane.adj_right_same_direction)
                row.insert(len(row) if leftwards else 0, (key, same))
        done |= {key for key, _ in row}
        lefts = [lanes[key].left_vertices if same else lanes[key].right_vertices[::-1] for key, same in row]
        key, same = row[0]
        right = lanes[key].right_vertices if same else lanes[key].left_vertices[::-1]
        inner = lefts[:-1]
        ends, starts = [left[-1:] for left in inner], [left[:1] for left in reversed(inner)]
        yield np.concatenate([right, *ends, lefts[-1][::-1], *starts])


def lane_borders(network: Any, line: Array, reach: float, width: float) -> list[list[Point]]:
    """Return the borders of all lanes around a line, each once, as polylines, m."""
    from shapely import LineString

    around = _about(line, reach)
    borders = []
    for lane in network.lanelets:
        # The left border of a lane is the right one of the lane beside it, if both lead the same way.
        shared = lane.adj_left is not None and lane.adj_left_same_direction
        borders += [lane.right_vertices] if shared else [lane.left_vertices, lane.right_vertices]
    near = [LineString(border).simplify(ROADS.drawn_in * width).intersection(around) for border in borders]
    parts = [part for each in near for part in getattr(each, "geoms", [each])]
    return [[(float(x), float(y)) for x, y in part.coords] for part in parts if part.length > 0.0]


def _about(line: Array, reach: float) -> Any:
    """Return what is no farther than so much from a line, (k, 2) m, or from its only point."""
    from shapely import LineString

    return LineString(line if len(line) > 1 else np.repeat(line, 2, axis=0)).buffer(reach)


def walls_around(area: Any, start: Any, width: float) -> list[list[Point]]:
    """Return walls along the borders of that part of an area that holds the start."""
    parts = getattr(area, "geoms", [area])
    held = max(parts, key=lambda part: part.intersection(start).area, default=None)
    if held is None or held.is_empty:
        return []
    from shapely import prepare
    from shapely.geometry.polygon import orient

    inside = held.buffer(-1e-6 * width)
    prepare(inside)
    shape, walls = orient(held), []
    for ring in (shape.exterior, *shape.interiors):
        for chain in _chains([corner[:2] for corner in ring.coords], ROADS.shortest * width):
            wall = _wall_along(chain, inside, width) if len(chain) > 2 else None
            walls += [_wall(a, b, inside, width) for a, b in pairwise(chain)] if wall is None else [wall]
    return walls


def _chains(corners: Sequence[Point], shortest: float) -> Iterator[list[Point]]:
    """Parts of a ring, edge by edge, that turn to the right only, by less than `ROADS.most_turn`; no short edges."""
    chain: list[Point] = []
    turned, before = 0.0, 0.0
    for a, b in pairwise(corners):
        if math.dist(a, b) <= shortest:
            continue
        heading = math.atan2(b[1] - a[1], b[0] - a[0])
        turn = math.remainder(heading - before, 2.0 * math.pi)
        if chain and chain[-1] == a and turn <= 0.0 and turned - turn < ROADS.most_turn:
            chain.append(b)
            turned -= turn
        else:
            if chain:
                yield chain
            chain, turned = [a, b], 0.0
        before = heading
    if chain:
        yield chain


def _wall_along(chain: Sequence[Point], inside: Any, width: float) -> list[Point] | None:
    """One wall along edges that turn to the right; None where it does not fit beside an area."""
    from shapely import MultiPoint

    behind = []
    for a, b, at in ((chain[0], chain[1], chain[0]), (chain[-2], chain[-1], chain[-1])):
        scale = ROADS.thickness * width / math.dist(a, b)
        behind.append((at[0] + scale * (b[1] - a[1]), at[1] + scale * (a[0] - b[0])))
    hull = MultiPoint([*chain, *behind]).convex_hull
    return None if inside.intersects(hull) else [(float(x), float(y)) for x, y in hull.exterior.coords[:-1]]


def _wall(a: Point, b: Point, inside: Any, width: float) -> list[Point]:
    """A wall to the right of an edge, as thick as fits beside an area."""
    from shapely import Polygon

    length, thickness = math.dist(a, b), ROADS.thickness * width
    right = ((b[1] - a[1]) / length, (a[0] - b[0]) / length)
    for _ in range(ROADS.halvings):
        c, d = ((x + thickness * right[0], y + thickness * right[1]) for x, y in (b, a))
        if not inside.intersects(Polygon([a, b, c, d])):
            break
        thickness *= 0.5
    return [a, d, c, b]
