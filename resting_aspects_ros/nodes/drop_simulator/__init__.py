"""The node that drops parts and publishes resting poses.

Serves the action `drop_part`, and publishes the parts of a folder. `shared_drops` joins identical
concurrent goals, `drop_production` runs the workers and publishes batches. Read `node.py` first.
"""
