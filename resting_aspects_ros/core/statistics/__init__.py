"""Statistics of counts over aspects.

Contains distributions with their intervals, the rule by which a run stops, the comparison of two
distributions, and how counts developed during a run. May import `core.aspects`.
Read `distribution.py` first, then `intervals.py`.
"""
