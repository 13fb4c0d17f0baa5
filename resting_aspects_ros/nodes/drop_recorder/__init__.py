"""The node that writes each run to an MCAP log of its own.

`run_recorder` records one run; `log_folder` checks the folder. Read `node.py` first.
"""
