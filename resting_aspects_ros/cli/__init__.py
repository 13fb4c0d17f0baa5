"""The command `resting_aspects`.

`main.py` imports only the module of the requested subcommand, from `verbs`. `options` holds flags
that several subcommands share. May import all other packages. Read `main.py` first, then
`verbs/drop.py`.
"""
