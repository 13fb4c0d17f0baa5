"""The public Python interface: load parts, drop them, estimate, classify and compare.

Composes `core`, `simulation` and `report` for scripts, notebooks and the command line. Imports no
ROS; only what reads a log does, when it is called. The names that users import are offered by
`resting_aspects_ros` itself. Read `drop.py` first.
"""
