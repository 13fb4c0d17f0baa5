"""Tables and pictures of distributions."""
