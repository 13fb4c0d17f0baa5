"""What a log says of its run: part, conditions, poses and counts.

Reads logs with the serialisation of messages, and therefore imports ROS. Used by the commands
that take a log. Read `contents.py` first.
"""
