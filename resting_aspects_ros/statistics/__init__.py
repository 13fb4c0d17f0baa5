"""Statistics of counts over aspects, and Markov chains of actions."""
