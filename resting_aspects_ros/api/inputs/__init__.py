"""Files and arguments that a person gives: parts, counts, poses and results.

Each is checked completely, and refused with its file, line, value and what was expected.
Read `part_argument.py` first.
"""
