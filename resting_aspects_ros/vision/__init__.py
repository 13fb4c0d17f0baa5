"""Vision: what a camera straight above sees of a part, and how it is recognized."""
