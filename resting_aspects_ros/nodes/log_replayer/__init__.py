"""The node that publishes a log again.

`player` decides when which message is published, `topics` creates the publishers.
Read `node.py` first.
"""
