"""The area that two polygons have in common."""

import shapely

# Spacing of the grid of the second attempt, as a share of the root of the area.
GRID = 1e-7


def common_area(one: shapely.Polygon, other: shapely.Polygon) -> float:
    """Return the area of the intersection of two polygons, m2.

    GEOS 3.14 finds only a few common points of some convex polygons that differ by rounding errors
    alone. They are then moved to a grid, which takes ten times as long.
    """
    area = float(shapely.intersection(one, other).area)
    if area == 0 and shapely.intersects(one, other):
        grid = GRID * float(one.area) ** 0.5
        area = float(shapely.intersection(one, other, grid_size=grid).area)
    return area
