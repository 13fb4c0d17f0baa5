"""The validation of drops, actions, vision and feeder: `make validate`."""
