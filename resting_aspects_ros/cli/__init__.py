"""The command `resting_aspects`.

`main.py` imports only the module of the subcommand that is called, from `verbs`; `inputs` reads
the files that a person gives; `options` holds flags that several subcommands share. May import
all other packages. Read `main.py` first, then `verbs/drop.py`.
"""
