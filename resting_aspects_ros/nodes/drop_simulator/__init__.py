"""The node that drops parts, makes actions on them, and publishes the results.

Serves the actions `drop_part` and `reorient_part`, and publishes the parts of a folder.
`shared_drops` joins identical concurrent goals, `drop_production` runs the workers and publishes
batches, `reorientation` publishes transition matrices. Read `node.py` first.
"""
