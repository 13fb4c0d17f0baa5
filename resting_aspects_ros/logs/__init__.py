"""MCAP logs that are compatible with rosbag2.

Contains the writer, three readers (by index, as a stream, for playback) and the recovery of logs
that were not closed. This is the only package that imports mcap, and it does not depend on ROS.
Read `run_writer.py` first, then `record_reader.py`.
"""
