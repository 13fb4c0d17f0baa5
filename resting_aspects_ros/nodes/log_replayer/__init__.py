"""The node that replays a log.

`player` selects the topics and their QoS, and decides when each message is published.
Read `node.py` first.
"""
