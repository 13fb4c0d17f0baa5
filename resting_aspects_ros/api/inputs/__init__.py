"""Readers of input files: counts, poses and results.

Each file is checked completely. An error names the file, the line, the value and what was
expected. Read `csv_table.py` first.
"""
