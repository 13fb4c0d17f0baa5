"""The ROS nodes, one package for each.

Each node has a module `node.py` with its parameters, thin callbacks and `main`; the work is in
the modules beside it. A node may import `ros` and everything below, but no other node; what two
nodes need is in `ros`. Read `drop_simulator/node.py` first.
"""
