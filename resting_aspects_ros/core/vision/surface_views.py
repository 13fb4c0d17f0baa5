"""An observed polygon as it would be on the tray, for boundaries at different heights."""

import numpy as np
import shapely

from resting_aspects_ros.core.vision.camera import Pinhole, Telecentric
from resting_aspects_ros.core.vision.fitting import Shape
from resting_aspects_ros.core.vision.likelihood import OutlineNoise

# Details of an observed polygon that are smaller than this share of the noise are left out.
DETAIL = 0.25


class SurfaceViews:
    """The observed polygon as it would be on the tray, by height of its silhouette."""

    def __init__(
        self, seen: shapely.Polygon, noise: OutlineNoise, camera: Telecentric | None
    ) -> None:
        simple = seen.simplify(DETAIL * noise.sd, preserve_topology=False)
        whole = isinstance(simple, shapely.Polygon) and simple.is_valid and simple.area > 0
        self._seen = simple if whole else seen
        self._camera = camera
        self._views: dict[float, Shape] = {}

    def at(self, height: float) -> Shape:
        """Return the polygon as it is if the whole boundary is at a height, m."""
        height = height if self._camera is not None else 0.0
        if height not in self._views:
            polygon = self._seen
            if self._camera is not None:
                polygon = self._camera.projected(polygon, height)
            self._views[height] = Shape(polygon)
        return self._views[height]

    def parallax(self, height: float) -> float:
        """Return by how much the outline of a part may differ from the view at its height, m.

        An edge at the height 0 is displaced most, by its distance from the foot point times
        height / H.
        """
        if not isinstance(self._camera, Pinhole):
            return 0.0
        x, y, top = self._camera.position
        reach = np.linalg.norm(shapely.get_coordinates(self._seen) - (x, y), axis=1).max()
        return float(reach * height / top)
