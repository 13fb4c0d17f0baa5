"""The page `resting_aspects studio`: a local server, and what it shows.

May import all rooms except cli, nodes, client, run_logs and ros. It computes nothing: a tab calls
public functions and shows their results with the kit of the report. Read `tabs.py` first.
"""
