"""The node that records each run in an MCAP log of its own.

`node` has the folder of the logs and the topics of runs; `feeder_recorder` records the topics of a
feeder. Read `node.py` first.
"""
