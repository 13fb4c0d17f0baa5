"""Track: which orientations of a part pass the traps of a bowl or linear feeder."""
