"""Shared code of all ROS nodes and clients of the suite.

Contains names and QoS, conversions between domain types and messages, parameters, diagnostics
and guarded callbacks. May import rclpy and the rooms below, but neither nodes nor the client.
Read `interface.py` first, then `conversions.py`.
"""
