"""Statistics of counts over aspects.

Contains distributions with their intervals, the stopping rule of a run, the comparison of two
distributions, and the development of the counts during a run. May import `core.aspects`.
Read `distribution.py` first, then `intervals.py`.
"""
