"""The subcommands, a module for each.

Each module has DESCRIPTION, EXAMPLES, `add_arguments` and `run`. What takes long to import is
imported in `run`. Read `aspects.py` first, the shortest.
"""
