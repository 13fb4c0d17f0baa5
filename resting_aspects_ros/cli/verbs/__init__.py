"""The subcommands, one module each.

Each module has DESCRIPTION, EXAMPLES, `add_arguments` and `run`. Slow imports are in `run`. Read
`aspects.py` first, the shortest.
"""
