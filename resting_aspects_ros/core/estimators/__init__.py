"""Analytic estimates of a distribution, without drops.

Contains the published methods. May import `core.geometry` and `core.aspects`. Read `estimate.py`
first.
"""
