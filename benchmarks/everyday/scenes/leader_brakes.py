"""A car follows another one that brakes to a stand and drives on later."""

from benchmarks.everyday.motions import polyline
from benchmarks.everyday.scene import CAR, Scene, car, pass_by


def make(seed: int) -> Scene:
    brakes = 4.0 + 0.3 * seed
    points = [(0.0, 32.0, 0.0), (brakes, 32.0 + 8.0 * brakes, 0.0)]
    points += [(brakes + 0.25 * k, 32.0 + 8.0 * brakes + 2.0 * k - 0.125 * k**2, 0.0) for k in range(1, 9)]
    time, x, _ = points[-1]
    points += [(time + 5.0 + 0.5 * k, x + 0.25 * k**2, 0.0) for k in range(9)]
    time, x, _ = points[-1]
    points.append((time + 40.0, x + 40.0 * 8.0, 0.0))
    return Scene(
        {**CAR, "max_speed": 12.0},
        (0.0, 0.0, 0.0, 8.0),
        [pass_by(160.0, 0.0, 2.0)],
        [car("leader", polyline(points))],
        60.0,
        bounds=((-10.0, -2.0), (220.0, 2.0)),
        noise=0.05,
    )
