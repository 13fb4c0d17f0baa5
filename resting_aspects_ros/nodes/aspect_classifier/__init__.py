"""The node that counts resting poses by aspect and answers requests.

`get_distribution` and `classify_pose` implement the services, `publishers` the topics,
`run_counting` counts active runs, and `distribution_store` keeps finished distributions. Read
`node.py` first, then `run_counting.py`.
"""
