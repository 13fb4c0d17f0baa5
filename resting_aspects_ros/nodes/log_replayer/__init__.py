"""The node that replays a log."""
