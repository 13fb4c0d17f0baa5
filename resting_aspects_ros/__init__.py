"""Natural resting aspects of parts, by simulated drops, as a ROS 2 node suite and a command."""

__version__ = '0.1.0'
