"""The node that records each run, and the topics of a feeder, in MCAP logs."""
