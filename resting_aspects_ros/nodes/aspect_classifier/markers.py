"""RViz markers: a part in each of its aspects, with the probabilities."""

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.format import aspect_colour, probability_text, rgb
from resting_aspects_ros.report.picture import AspectPose, aspect_poses, message_faces
from resting_aspects_ros.ros.interface import FRAME
from resting_aspects_ros.statistics.distribution import Distribution

# Namespaces of the mesh and text markers; the id of a marker is the id of the aspect.
MESHES, TEXTS = 'aspects', 'probabilities'
# Height of the letters, and of their centre above the part, in units of R. With this height, ten
# letters fit between two aspects.
LETTERS, ABOVE = 0.3, 0.35
TEXT_COLOUR = '#FFFFFF'  # on RViz's dark background


class PartMarkers:
    """The markers of one part, created once: only texts and stamps change with drops.

    Meshes are sent as triangles: a mesh resource would be a path of the simulator's machine, and
    RViz knows neither all formats of parts nor their units.
    """

    def __init__(self, part: Part, aspects: AspectSet, frame: str = FRAME) -> None:
        self._frame = frame
        self._delete_all = Marker(action=Marker.DELETEALL)
        standing = aspect_poses(part, aspects.aspects)
        triangles = part.vertices[message_faces(part, aspects.aspects)].reshape(-1, 3)
        points = [_point(point) for point in triangles]
        self._meshes = [
            _mesh(one, aspect_colour(aspect), points)
            for one, aspect in zip(standing, aspects.aspects, strict=True)
        ]
        self._texts = [_text(one, part.hull_radius) for one in standing]

    def message(self, distribution: Distribution, stamp: Time) -> MarkerArray:
        """Return a marker that deletes all previous markers, followed by the markers of the part.

        The next call modifies the returned message.
        """
        for text, label in zip(self._texts, labels(distribution), strict=True):
            text.text = label
        markers = [self._delete_all, *self._meshes, *self._texts]
        header = Header(stamp=stamp, frame_id=self._frame)
        for marker in markers:
            marker.header = header
        return MarkerArray(markers=markers)


def labels(distribution: Distribution) -> list[str]:
    """Return the text above each aspect, such as '2: 27.1 %', or '2: no drops' without drops.

    The number of digits depends on the number of drops.
    """
    rows = zip(distribution.aspects.aspects, distribution.intervals(), strict=True)
    return [
        f'{aspect.id}: {probability_text(interval) if distribution.drops else "no drops"}'
        for aspect, interval in rows
    ]


def _mesh(standing: AspectPose, colour: str, points: list[Point]) -> Marker:
    orientation = standing.orientation.tolist()
    return Marker(
        ns=MESHES,
        id=standing.aspect_id,
        type=Marker.TRIANGLE_LIST,
        action=Marker.ADD,
        pose=Pose(
            position=_point(standing.position),
            orientation=Quaternion(**dict(zip('xyzw', orientation, strict=True))),
        ),
        scale=Vector3(x=1.0, y=1.0, z=1.0),
        color=_colour(colour),
        points=points,
    )


def _text(standing: AspectPose, radius: float) -> Marker:
    x, y, _ = standing.centre_of_mass.tolist()
    return Marker(
        ns=TEXTS,
        id=standing.aspect_id,
        type=Marker.TEXT_VIEW_FACING,
        action=Marker.ADD,
        pose=Pose(position=Point(x=x, y=y, z=standing.top + ABOVE * radius)),
        scale=Vector3(z=LETTERS * radius),
        color=_colour(TEXT_COLOUR),
    )


def _point(point: Array) -> Point:
    return Point(**dict(zip('xyz', point.tolist(), strict=True)))


def _colour(text: str) -> ColorRGBA:
    """Return the opaque colour for a text '#RRGGBB'."""
    red, green, blue = rgb(text)
    return ColorRGBA(r=red, g=green, b=blue, a=1.0)
