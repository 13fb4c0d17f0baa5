"""Geometry of meshes: reading, checking, hulls, mass and surfaces.

Contains algorithms on meshes and polyhedra that do not depend on resting. All packages may import
it; it imports only the errors, units and rotations of `core`. Read `closed_surface.py` first,
which defines which meshes bound a solid, then `polyhedron.py`, on which `core.aspects` works.
"""
