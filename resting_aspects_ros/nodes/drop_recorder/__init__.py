"""The node that records each run in an MCAP log of its own.

`run_topics` has the folder of the logs, reports errors, and records actions and surroundings;
`feeder_recorder` records the topics of a feeder. Read `node.py` first.
"""
