"""MCAP logs, as rosbag2 writes and reads them.

Contains the writer, three readers (by index, as a stream, for playback) and the recovery of logs
that were broken off. The only package that imports mcap; knows no ROS. Read `run_writer.py`
first, then `record_reader.py`.
"""
