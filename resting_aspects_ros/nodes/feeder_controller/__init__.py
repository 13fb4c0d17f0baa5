"""The node that advises a feeder: what to pick, and when to flip, spread or supply parts.

`tray_state` keeps the newest image and the epochs, `model` builds the model of the decision, and
`core/feeding/decision` decides. Read `node.py` first, then `tray_state.py`.
"""
