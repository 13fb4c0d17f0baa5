"""The public Python interface: load parts, drop them, estimate, classify and compare.

For scripts, notebooks and the command line. Imports no ROS, except functions that read or write a
log, when they are called. Users import the public names from `resting_aspects_ros`. Read `drop.py`
first.
"""
