"""The log of a run: what one says of its run, and how one is written.

Reads and writes messages in their serialized form, and therefore imports ROS. The command line and
the Python interface import it only when a log is read or written. Read `contents.py` first, then
`run_recorder.py`.
"""
