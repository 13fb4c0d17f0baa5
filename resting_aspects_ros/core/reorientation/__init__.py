"""Reorientation: how the actions of a feeder move parts from aspect to aspect.

Contains transition matrices, the long-run shares and hitting probabilities of their Markov chains,
the best plan of actions, and retention curves. May import `core.aspects` and `core.statistics`.
Read `transition_matrix.py` first, then `markov.py`.
"""
