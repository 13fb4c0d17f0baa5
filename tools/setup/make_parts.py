"""Writes the meshes of the examples, as binary STL in mm: make_parts.py [FOLDER].

Parts are written into config/parts, and surfaces on which parts are dropped into
config/surroundings; both into FOLDER if it is given. The same bytes every time; a test holds the
files in config against this script.
"""

import math
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

from trimesh import Trimesh

Point = tuple[float, float]
Triangle = tuple[int, int, int]

CONFIG = Path(__file__).parents[2] / 'config'

# Sides of every circle. The corners lie on the circle, so that a disc of radius r has the area
# n / 2 r^2 sin(2 pi / n), which is 0.16 % less than that of the circle.
SIDES = 64


def prism(outline: list[Point], height: float) -> Trimesh:
    """A simple polygon, counterclockwise, extruded along z from 0 to the height."""
    n = len(outline)
    top = triangulated(outline)
    bottom = [(c, b, a) for a, b, c in top]
    sides = strip(list(range(n)), list(range(n, 2 * n)))
    return Trimesh(
        [(*p, z) for z in (0, height) for p in outline],
        bottom + [shifted(t, n) for t in top] + sides,
        process=False,
    )


def tube(outer: list[Point], inner: list[Point], height: float) -> Trimesh:
    """The ring between two polygons, both counterclockwise about 0, extruded along z from 0."""
    n, m = len(outer), len(inner)
    top = ring(outer, inner)
    bottom = [(c, b, a) for a, b, c in top]
    low, high = list(range(n + m)), list(range(n + m, 2 * (n + m)))
    sides = strip(low[:n], high[:n]) + strip(high[n:], low[n:])
    return Trimesh(
        [(*p, z) for z in (0, height) for p in outer + inner],
        bottom + [shifted(t, n + m) for t in top] + sides,
        process=False,
    )


def strip(low: list[int], high: list[int]) -> list[Triangle]:
    """The band between two closed chains of as many points."""
    around = list(zip(low, low[1:] + low[:1], high, high[1:] + high[:1], strict=True))
    return [t for a, b, c, d in around for t in ((a, b, d), (a, d, c))]


def ring(outer: list[Point], inner: list[Point]) -> list[Triangle]:
    """The flat ring between two polygons, each in the order of the angle from 0 on."""
    n, m = len(outer), len(inner)
    angles_outer = [math.atan2(y, x) % (2 * math.pi) for x, y in outer] + [math.inf]
    angles_inner = [math.atan2(y, x) % (2 * math.pi) for x, y in inner] + [math.inf]
    triangles = []
    i = j = 0
    while i < n or j < m:
        here = (i % n, n + j % m)
        if j == m or (i < n and angles_outer[i + 1] <= angles_inner[j + 1]):
            i += 1
            triangles.append((here[0], i % n, here[1]))
        else:
            j += 1
            triangles.append((here[0], n + j % m, here[1]))
    return triangles


def triangulated(outline: list[Point]) -> list[Triangle]:
    """A simple polygon, cut up by clipping ears."""
    left = list(range(len(outline)))
    triangles = []
    while len(left) > 2:
        ears = zip(left[-1:] + left[:-1], left, left[1:] + left[:1], strict=True)
        ear = next(ear for ear in ears if is_ear(ear, left, outline))
        triangles.append(ear)
        left.remove(ear[1])
    return triangles


def is_ear(ear: Triangle, left: list[int], outline: list[Point]) -> bool:
    """Tell whether a triangle of neighbours lies inside the polygon with nothing in it."""
    a, b, c = (outline[i] for i in ear)
    others = (outline[i] for i in left if i not in ear)
    return turn(a, b, c) > 0 and not any(
        turn(a, b, p) >= 0 and turn(b, c, p) >= 0 and turn(c, a, p) >= 0 for p in others
    )


def turn(a: Point, b: Point, c: Point) -> float:
    """Twice the area of a triangle, positive if it is counterclockwise."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def shifted(triangle: Triangle, by: int) -> Triangle:
    """The same triangle between points that are further back in the list."""
    a, b, c = triangle
    return a + by, b + by, c + by


def angle_profile(x: float, y: float, thick: float) -> list[Point]:
    """An L: outside lengths of its legs along x and y, and their thickness."""
    return [(0, 0), (x, 0), (x, thick), (thick, thick), (thick, y), (0, y)]


def polygon(sides: int, radius: float) -> list[Point]:
    """A regular polygon with its corners on a circle about 0, the first one on the x axis."""
    turns = (2 * math.pi * i / sides for i in range(sides))
    return [(radius * math.cos(t), radius * math.sin(t)) for t in turns]


def tetrahedron(edge: float) -> Trimesh:
    """A regular tetrahedron about 0: four corners of a cube."""
    a = edge / math.sqrt(8)
    return Trimesh(
        [(a, a, a), (a, -a, -a), (-a, a, -a), (-a, -a, a)],
        [(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)],
        process=False,
    )


def pocket(plate: float, top: float, bottom: float, depth: float, below: float) -> Trimesh:
    """A square plate with a square pocket: its top at the height ``depth``, its bottom at 0.

    plate, top, bottom : sides of the plate, and of the pocket at its top and at its bottom.
    below : thickness of the plate below the pocket.
    """
    squares = [(plate, -below), (plate, depth), (top, depth), (bottom, 0.0)]
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    rings = [[4 * k + i for i in range(4)] for k in range(len(squares))]
    bands = [t for low, high in pairwise(rings) for t in strip(low, high)]
    a, b, c, d = rings[0]
    e, f, g, h = rings[-1]
    return Trimesh(
        [(x * side / 2, y * side / 2, z) for side, z in squares for x, y in corners],
        [(c, b, a), (d, c, a), *bands, (e, f, g), (e, g, h)],
        process=False,
    )


PARTS: dict[str, Callable[[], Trimesh]] = {
    # Exactly degenerate: its centre of mass, (15, 10, 10), is above an edge of the long leg's end.
    'l_bracket': lambda: prism(angle_profile(40, 30, 10), 20),
    'angle_45x30x8': lambda: prism(angle_profile(45, 30, 8), 20),
    # A flange of 40 x 10 on a web of 10 x 30; 40 high in all.
    't_prism': lambda: prism(
        [(-5, 0), (5, 0), (5, 30), (20, 30), (20, 40), (-20, 40), (-20, 30), (-5, 30)], 20
    ),
    'box_10x20x30': lambda: prism([(0, 0), (10, 0), (10, 20), (0, 20)], 30),
    'cylinder_d20_h20': lambda: prism(polygon(SIDES, 10), 20),
    # For M8, as in ISO 7089.
    'washer': lambda: tube(polygon(SIDES, 8), polygon(SIDES, 4.2), 1.6),
    # 17 across flats with a plain bore of 10, as an M10 nut of ISO 4032 without its chamfers.
    'hex_nut': lambda: tube(polygon(6, 17 / math.sqrt(3)), polygon(SIDES, 5), 8.4),
    # 30 wide and 25 high outside, walls of 5.
    'u_bracket': lambda: prism(
        [(0, 0), (30, 0), (30, 25), (25, 25), (25, 5), (5, 5), (5, 25), (0, 25)], 20
    ),
    'tetrahedron': lambda: tetrahedron(30),
}

SURROUNDINGS: dict[str, Callable[[], Trimesh]] = {
    # Its sides are inclined by 45 degrees.
    'pocket': lambda: pocket(plate=240, top=160, bottom=120, depth=20, below=10)
}


def main(parts: Path, surroundings: Path) -> None:
    """Write all parts, and all surfaces of surroundings."""
    for folder, meshes in ((parts, PARTS), (surroundings, SURROUNDINGS)):
        folder.mkdir(parents=True, exist_ok=True)
        for name, make in meshes.items():
            data = make().export(file_type='stl')
            assert isinstance(data, bytes)
            (folder / f'{name}.stl').write_bytes(data)


if __name__ == '__main__':
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]), Path(sys.argv[1]))
    else:
        main(CONFIG / 'parts', CONFIG / 'surroundings')
