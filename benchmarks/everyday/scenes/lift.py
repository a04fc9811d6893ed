"""Four people leave a lift before the robot goes in."""

from benchmarks.everyday.motions import polyline
from benchmarks.everyday.scene import ROBOT, Scene, box, person, stop_at


def make(seed: int) -> Scene:
    walls = [box(6.0, -1.6, 6.2, -0.6), box(6.0, 0.6, 6.2, 1.6), box(6.0, 1.4, 8.4, 1.6), box(6.0, -1.6, 8.4, -1.4)]
    walls.append(box(8.2, -1.6, 8.4, 1.6))
    people = []
    for k, (x, y) in enumerate(((6.9, 0.4), (6.9, -0.4), (7.6, 0.4), (7.6, -0.4))):
        out = 2.0 + 1.3 * k + 0.1 * seed
        side = 1.0 if y > 0.0 else -1.0
        way = [(out, x, y), (out + 1.5, 5.6, 0.1 * side), (out + 4.0, 3.6, 1.9 * side), (out + 9.0, 0.0, 4.5 * side)]
        people.append(person(f"p{k}", polyline([(0.0, x, y), *way])))
    return Scene(ROBOT, (0.0, 0.0, 0.0, 0.0), [stop_at(7.4, 0.0)], people, 45.0, walls=walls)
