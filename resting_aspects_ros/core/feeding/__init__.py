"""Feeding: how many parts of a tray a robot can pick, and how many parts per minute that gives.

Parts are numbers here: shares of aspects, and lengths and widths of outlines. May import
`core.aspects`, `core.statistics` and `core.reorientation`. Read `cycle.py` first, then
`steady_state.py` and `forecast.py`.
"""
