"""The node that counts resting poses by aspect and answers requests.

`get_distribution` and `classify_pose` implement the services, `publishers` the topics,
`run_counting` counts active runs, `distribution_store` keeps finished distributions, and
`transition_store` keeps transition matrices. `outline_store` computes outlines, which
`outline_service` uses to identify and locate parts. `live_monitor` combines counted parts with the
simulation, and `forecast_service` forecasts the rate of a feeder. Read `node.py` first, then
`run_counting.py`.
"""
