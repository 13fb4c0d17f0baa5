"""How part and surroundings are represented where more than planes meet the part."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from resting_aspects_ros.api.surroundings import scene_of
from resting_aspects_ros.errors import PartError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.pieces import ConvexPieces, convex_pieces
from resting_aspects_ros.report.format import number_text
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.scene import MeshBody

# Shorter distances, m, are rounding errors.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class SimulatedShapes:
    """Shapes that the simulation uses instead of the real ones.

    pieces : ConvexPieces
        Of the part.
    mesh : MeshBody or None
        The mesh of the surroundings, with its flat sides as prisms and its other sides simplified.
    """

    pieces: ConvexPieces
    mesh: MeshBody | None

    def document(self) -> dict[str, Any]:
        """Return the fields of a JSON document of drops."""
        fields: dict[str, Any] = {'convex_pieces': self.pieces.summary()}
        if self.mesh is not None:
            fields['mesh_surface'] = {
                'triangles': len(self.mesh.triangles),
                'flat_sides': self.mesh.sides,
                'prisms': len(self.mesh.prisms),
                'remaining_triangles': _remaining(self.mesh),
                'distance': self.mesh.distance,
            }
        return fields

    def sentences(self) -> Iterator[str]:
        """Yield a sentence about each shape."""
        what = 'The edge meets' if self.mesh is None else 'The mesh meets'
        yield pieces_text(self.pieces, what)
        if self.mesh is not None:
            yield _mesh_text(self.mesh)


def simulated_shapes(part: Part | None, conditions: DropConditions) -> SimulatedShapes | None:
    """Return the shapes that drops of a part use; None if only planes meet it, or not known.

    They are not known without the part, without the mesh of the surroundings, and if CoACD is not
    installed where a result of another machine is shown.
    """
    around = conditions.surroundings
    if part is None or around is None or not around.known:
        return None
    try:
        scene = scene_of(part, conditions)
        if scene.flat:
            return None
        pieces = convex_pieces(part)
    except PartError:
        return None
    return SimulatedShapes(
        pieces, next((b for b in scene.bodies if isinstance(b, MeshBody)), None)
    )


def pieces_text(pieces: ConvexPieces, what: str) -> str:
    """Return in words how far convex pieces are from the part; ``what`` meets the part."""
    number = len(pieces.corners)
    missing, excess = (_millimetres(each) for each in (pieces.missing, pieces.excess))
    return (
        f'{what} the part as {number} convex {"piece" if number == 1 else "pieces"}: at '
        f'most {missing} mm of it are missing, at most {excess} mm are extra, and the volume '
        f'differs by {100 * pieces.volume_error:+.1f} %.'
    )


def _millimetres(length: float) -> str:
    return number_text(1000 * length) if length >= ROUNDING else '0'


def _mesh_text(mesh: MeshBody) -> str:
    remaining = _number(_remaining(mesh), 'triangle')
    if not mesh.prisms and not mesh.distance:
        return f'The part meets the {remaining} of the mesh.'
    simulated = []
    if mesh.prisms:
        sides = _number(mesh.sides, 'flat side')
        prisms = _number(len(mesh.prisms), 'convex prism')
        simulated.append(f'{prisms}, into which the triangles of {sides} are merged')
    if mesh.distance:
        away = _millimetres(mesh.distance)
        simulated.append(f'{remaining}, which are at most {away} mm away from its curved sides')
    elif _remaining(mesh):
        simulated.append(f'its other {remaining}')
    return (
        f'The mesh of {len(mesh.triangles):,} triangles is simulated as '
        f'{", and ".join(simulated)}.'
    )


def _remaining(mesh: MeshBody) -> int:
    return len(mesh.triangles if mesh.remaining is None else mesh.remaining)


def _number(number: int, what: str) -> str:
    return f'{number:,} {what}{"" if number == 1 else "s"}'
