"""Natural resting aspects of a part, determined from its shape alone."""
