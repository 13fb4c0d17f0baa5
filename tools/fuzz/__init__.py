"""Random inputs and parts, and what must hold for them."""
