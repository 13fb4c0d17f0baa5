"""Calibration: from counts by hand to the restitution and the friction of a surface.

Read `counts_file.py` first, then `posterior.py` and `calibrate.py`.
"""
