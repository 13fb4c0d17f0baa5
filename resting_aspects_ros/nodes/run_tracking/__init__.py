"""Tracking of runs by their batches of poses; shared by the classifier and the recorder.

Detects lost batches and asks the simulator for them again, and detects the end of a run.
Read `tracker.py` first.
"""
