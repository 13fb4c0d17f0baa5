"""Logs of runs as MCAP."""
