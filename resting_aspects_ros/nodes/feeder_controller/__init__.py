"""The node that advises a feeder: what to pick, and when to flip, spread or supply parts.

`messages` has the parameters and the conversions, `model_updates` follows what is known of the
part, and the room `feeding` decides. Read `node.py` first.
"""
