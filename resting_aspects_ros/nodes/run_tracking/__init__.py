"""Tracking of runs by their batches of poses, shared by the classifier and the recorder.

Detects lost batches, requests them again from the simulator, and detects the end of a run.
Read `tracker.py` first.
"""
