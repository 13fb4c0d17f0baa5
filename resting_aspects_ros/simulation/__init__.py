"""Simulation of drops.

Contains the conditions, the physics engine, and the distribution of a run's drops over processes
or a Dask cluster. Only `bullet_*` may import pybullet, and only `dask_workers` may import
distributed. Of this project, the package may import only `core`. Read `plan.py` first, then
`chunks.py`.
"""
