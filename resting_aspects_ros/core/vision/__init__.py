"""Vision: what a camera straight above sees of a part, and how it is recognized.

Contains outlines, their alignment, identification, cameras and poses. May import `core`,
`core.geometry`, `core.aspects` and `core.statistics`, and is the only room of `core` that imports
shapely. Read `outline.py` first, then `look_alikes.py`.
"""
