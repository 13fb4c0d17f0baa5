"""The node that drops parts and publishes resting poses.

Serves the action `drop_part`, and publishes the parts of a folder. `shared_drops` joins identical
concurrent goals, `async_workers` awaits the worker processes. Read `node.py` first.
"""
