"""Geometry of meshes: reading, checking, hulls, mass and surfaces.

Contains algorithms on meshes and polyhedra that know nothing of resting. May be imported by all
rooms; imports only the errors, units and rotations of `core`. Read `closed_surface.py` first,
which says which meshes bound a solid, then `polyhedron.py`, on which `core.aspects` works.
"""
