"""Analytic estimates of a distribution, without drops.

Contains the published methods, and the advice on which of them to trust for a part. May import
`core.geometry`, `core.aspects` and `core.statistics`. Read `estimate.py` first.
"""
