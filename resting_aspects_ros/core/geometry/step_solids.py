"""The solids of a STEP file: which triangles are theirs, and their names."""

import re
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.geometry.closed_surface import WELD, weld_groups
from resting_aspects_ros.core.geometry.triangle_edges import (
    TriangleEdges,
    connected,
    triangle_edges,
)

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

SOLIDS = ('MANIFOLD_SOLID_BREP', 'BREP_WITH_VOIDS', 'FACETED_BREP')
# Edges that are followed to separate solids that touch, after which the rest is left out.
MAX_WORK = 10_000_000
# Items of a representation that have no shape of their own.
PLACES = ('AXIS2_PLACEMENT_3D', 'MAPPED_ITEM', 'CARTESIAN_POINT')

_TEXT = rb"'((?:[^']|'')*)'"
_REPRESENTATION = re.compile(
    rb'=\s*\w*SHAPE_REPRESENTATION\s*\(\s*' + _TEXT + rb'\s*,\s*\(([\s,#\d]*)\)'
)
_DIRECTIVE = re.compile(
    r'\\\\|\\X2\\((?:[0-9A-Fa-f]{4})+)\\X0\\|\\X4\\((?:[0-9A-Fa-f]{8})+)\\X0\\'
    r'|\\X\\([0-9A-Fa-f]{2})|\\P([A-I])\\|\\S\\([ -~])'
)
_ENTITY = re.compile(rb'#(\d+)\s*=\s*(\w+)\s*\(\s*(?:' + _TEXT + rb')?')


@dataclass(frozen=True)
class StepItems:
    """The items of the shapes in the text of a STEP file.

    solids : the names of the solids of each shape, empty for a solid without a name
    left_out : kind and name of each other item
    """

    solids: list[list[str]]
    left_out: list[str]

    @classmethod
    def of(cls, data: bytes) -> 'StepItems':
        """Return the items in the bytes of a STEP file."""
        shapes = [re.findall(rb'#(\d+)', found[1]) for found in _REPRESENTATION.findall(data)]
        wanted = {number for numbers in shapes for number in numbers}
        items = {
            number: (kind.decode().upper(), _decoded(name.decode(errors='replace')))
            for number, kind, name in _ENTITY.findall(data)
            if number in wanted
        }
        solids, left_out = [], []
        for numbers in shapes:
            found = [items[number] for number in numbers if number in items]
            solids.append([name for kind, name in found if kind in SOLIDS])
            left_out += [
                kind.lower().replace('_', ' ') + (f' {name!r}' if name else '')
                for kind, name in found
                if kind not in (*SOLIDS, *PLACES)
            ]
        return cls([names for names in solids if names], left_out)

    def names(self, count: int) -> list[str]:
        """Return the names of the solids of a shape with several; empty if they are not known."""
        fitting = [names for names in self.solids if len(names) == count]
        if count == 1 or len(fitting) != 1 or not all(fitting[0]):
            return []
        return fitting[0]

    def missing(self, found: int, others: int) -> int:
        """Return how many solids are missing among those found, with other triangles left."""
        surfaces = any('surface' in kind or 'shell' in kind for kind in self.left_out)
        expected = sum(map(len, self.solids))
        if not others or (surfaces and found >= expected):
            return 0
        return max(expected - found, 1)


def _decoded(text: str) -> str:
    """Return a text of a STEP file without the control directives of ISO 10303-21."""
    page = 'iso8859-1'

    def character(found: re.Match[str]) -> str:
        nonlocal page
        two, four, byte, letter, low = found.groups()
        if letter:
            page = f'iso8859-{ord(letter) - ord("A") + 1}'
            return ''
        if low:
            return bytes([ord(low) + 128]).decode(page, 'replace')
        if byte:
            return chr(int(byte, 16))
        if two or four:
            codec = 'utf-16-be' if two else 'utf-32-be'
            return bytes.fromhex(two or four).decode(codec, 'replace')
        return '\\'

    return _DIRECTIVE.sub(character, text.replace("''", "'"))


def solid_triangles(
    vertices: Array, triangles: Indices, face: Indices
) -> tuple[list[Indices], Indices]:
    """Return the rows of the triangles of each solid, and those of no solid.

    The faces of a solid follow each other, so a solid ends where all edges of its triangles are
    used equally often in both directions. A shell that faces inward is a cavity of the solid
    before it.

    Parameters
    ----------
    vertices : (n, 3) float64
    triangles : (m, 3) int64
    face : (m,) int64
        The number of the face of the solid that each triangle is on.
    """
    size = float(np.ptp(vertices, axis=0).max()) / 2
    a, b, c = corners = weld_groups(vertices, WELD * size)[1][triangles].T
    kept = np.flatnonzero((a != b) & (b != c) & (c != a))
    kept = kept[np.argsort(face[kept], kind='stable')]
    edges = triangle_edges(corners.T[kept])
    component = _linked_by_edges(edges, face[kept])
    shells: list[Indices] = []
    rest: list[Indices] = [kept[:0]]
    for rows in np.split(np.argsort(component, kind='stable'), _starts(np.sort(component))):
        closed, other = _closed_shells(rows, edges, face[kept])
        shells += [kept[shell] for shell in closed]
        rest.append(kept[other])
    solids: list[Indices] = []
    for shell in sorted(shells, key=lambda rows: int(face[rows].min())):
        points = vertices[triangles[shell]] - vertices[triangles[shell[0], 0]]
        if solids and np.linalg.det(points).sum() < 0:
            solids[-1] = np.concatenate([solids[-1], shell])
        else:
            solids.append(shell)
    return solids, np.concatenate(rest)


def _starts(numbers: Indices) -> Indices:
    """Return where a new number begins in sorted numbers, except at the beginning."""
    return np.flatnonzero(np.diff(numbers)) + 1


def _linked_by_edges(edges: TriangleEdges, face: Indices) -> Indices:
    """Return for each triangle the number of the component of faces that share edges."""
    pairs = np.stack([np.repeat(face, 3), face.max(initial=0) + 1 + edges.number], axis=1)
    return connected(int(pairs.max(initial=-1)) + 1, pairs)[face]


def _closed_shells(
    rows: Indices, edges: TriangleEdges, face: Indices
) -> tuple[list[Indices], Indices]:
    """Return the closed shells among triangles, sorted by their faces, and the other triangles."""
    uses = (3 * rows[:, None] + np.arange(3)).ravel()
    number, direction = edges.number[uses], edges.direction[uses]
    twice = bool((np.bincount(number)[number] == 2).all())
    if twice and not np.bincount(number, weights=direction).any():
        return [rows], rows[:0]
    faces = np.split(rows, _starts(face[rows]))
    steps = [
        list(zip(n.tolist(), d.tolist(), strict=True))
        for n, d in (
            (edges.number.reshape(-1, 3)[f].ravel(), edges.direction.reshape(-1, 3)[f].ravel())
            for f in faces
        )
    ]
    shells: list[Indices] = []
    others: list[Indices] = [rows[:0]]
    start, work = 0, 0
    while start < len(faces):
        balance: dict[int, int] = {}
        for end in range(start, len(faces) if work < MAX_WORK else start):
            for edge, way in steps[end]:
                balance[edge] = balance.get(edge, 0) + way
                if not balance[edge]:
                    del balance[edge]
            work += len(steps[end])
            if not balance:
                shells.append(np.concatenate(faces[start : end + 1]))
                start = end + 1
                break
        else:
            others.append(faces[start])
            start += 1
    return shells, np.concatenate(others)
