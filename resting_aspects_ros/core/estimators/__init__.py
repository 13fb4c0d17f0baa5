"""Analytic estimates of a distribution, without drops.

Contains the published methods, and the recommendation of a method for a part. May import
`core.geometry`, `core.aspects` and `core.statistics`. Read `estimate.py` first.
"""
