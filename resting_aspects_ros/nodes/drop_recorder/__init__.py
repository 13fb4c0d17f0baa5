"""The node that records each run in an MCAP log of its own.

`log_folder` checks and locks the folder of the logs, `run_topics` records actions and
surroundings, `feeder_recorder` the topics of a feeder, and `status_log` reports errors. Read
`node.py` first.
"""
