"""Natural resting aspects of a part, determined from its shape alone.

Contains the potential energy of a part on a plane (landscape), its minima (aspects), the saddles
between them (barriers), basins, supports and symmetry classes, and clusters of measured poses.
May import `core.geometry`. Read `aspect.py` first, then `landscape.py`.
"""
