"""The subcommands of `resting_aspects`, a module each; `add` declares one and `run` does it."""
