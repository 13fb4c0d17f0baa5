"""Reading and writing the log of a run.

The package uses serialized messages, and therefore imports ROS. The command line and
the Python interface import it only when a log is read or written. Read `contents.py` first, then
`recorder.py`.
"""
