"""How drops are made: parts and surfaces by name, conditions, the engine, campaigns."""
