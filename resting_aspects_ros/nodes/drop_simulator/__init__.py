"""The node that drops parts, makes actions on them, and publishes the results.

Serves the actions `drop_part` and `reorient_part`, and publishes the parts of a folder.
`goals` has the workers that all goals share, `drop_part` publishes resting poses, and
`reorientation` transition matrices. Read `node.py` first.
"""
