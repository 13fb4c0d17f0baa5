"""Example programs to copy. They import only the messages and `resting_aspects_ros.client`.

Read `feeder.py`: a feeder controller that subscribes to the distribution of its part.
"""
