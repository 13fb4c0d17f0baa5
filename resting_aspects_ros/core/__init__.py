"""Domain of the suite: parts, aspects and distributions.

The package defines natural resting aspects and finds, counts and estimates them. It may import
numpy, scipy, trimesh and the standard library, but no simulation engine, clock, random source or
ROS, which are passed in as arguments. Read `aspects/aspect.py` first, then
`statistics/distribution.py`.
"""
