"""Surroundings of a drop: slopes, walls, grooves, chutes, trays and meshes.

Contains their description, the bodies and the gravity that follow from it, where parts are
released, and when a part is at rest, slides or is lost. It knows no engine: `bullet_scene` puts
the bodies into Bullet. May import only `core` and, of `simulation`, what has no engine. Read
`kinds.py` first, then `scene.py`.
"""
