"""The node that counts resting poses by aspect and answers requests.

`drop_counter` counts the drops of resting_poses in `tallies`, which also have those of logs.
`get_distribution` and `classify_pose` implement the services, `publishers` and `markers` the
topics, and `transition_store` keeps transition matrices. `outlines` identifies and locates parts.
`live` combines counted parts with the simulation, and `forecast_service` forecasts the rate of a
feeder. Read `node.py` first, then `tallies.py`.
"""
