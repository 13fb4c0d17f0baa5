"""The node that counts resting poses by aspect and answers requests.

`counting` counts the drops of resting_poses and of logs. `known` has what is known of parts, logs
and transitions. `services` implements get_distribution, classify_pose and forecast, and `outlines`
identify_part. `publishers` sends distributions and markers, and `live` combines counted parts with
the simulation. Read `node.py` first, then `counting.py`.
"""
