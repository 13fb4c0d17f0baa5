"""MCAP logs that are compatible with rosbag2.

Contains the writer, the reader and the recovery of logs that were not closed. This is the only
package that imports mcap, and it does not depend on ROS. Read `writer.py` first, then `reader.py`.
"""
