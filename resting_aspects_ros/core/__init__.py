"""Domain of the suite: parts, aspects and distributions.

Contains what a natural resting aspect is and how it is found, counted and estimated. May import
numpy, scipy, trimesh and the standard library, but no simulation engine, clock, random source or
ROS: those are passed in. Read `aspects/aspect.py` first, then `statistics/distribution.py`.
"""
