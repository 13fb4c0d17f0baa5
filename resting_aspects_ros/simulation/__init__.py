"""Simulation of drops: conditions, actions, surroundings, engines, and workers.

A `DropJob` (job.py) is made of a part, conditions, a `Scene` (scene.py) and `Starts` (starts.py).
Drops start as release.py determines, move in the kernel or in Bullet, and end as resting poses.
Any range of drops of a job can be made by `workers.drop_range`. Only `bullet_world.py` imports
pybullet, and only `workers.py` imports distributed.
"""
