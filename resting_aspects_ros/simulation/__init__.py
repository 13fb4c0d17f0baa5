"""Simulation of drops.

Contains conditions, the physics engine, and how the drops of a run are distributed over processes
or a Dask cluster. Only `bullet_engine` may import pybullet, only `dask_workers` distributed; of
this package only `core` may be imported. Read `plan.py` first, then `chunks.py`.
"""
