"""The node that replays a log.

`player` decides when each message is published, `topics` selects the topics and their QoS.
Read `node.py` first.
"""
