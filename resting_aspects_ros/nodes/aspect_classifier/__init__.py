"""The node that counts resting poses by aspect and answers requests.

There is a module for each service (`get_distribution`, `classify_pose`), one for what is
published, and `distribution_store` for the counts. Read `node.py` first, then
`distribution_store.py`.
"""
