"""Feeding: how many parts of a tray a robot can pick, and how many parts per minute that gives."""
