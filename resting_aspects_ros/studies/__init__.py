"""Studies: drops over ranges of conditions, what they depend on, and what can be learned of them.

May import everything below `api` and `api` itself; the command line and the Python interface are
above it. ROS, nodes and the client do not import it.
"""
