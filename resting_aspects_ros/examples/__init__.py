"""Programs to copy. They import the messages and `resting_aspects_ros.client` only.

Read `feeder.py`: a feeder controller that requests a distribution, and subscribes to changes.
"""
