"""The node that advises a feeder: what to pick, and when to flip, spread or supply parts.

`model_updates` has the parameters and follows what is known of the part; the room `feeding`
decides. Read `node.py` first.
"""
