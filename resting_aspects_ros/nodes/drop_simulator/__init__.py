"""The node that drops parts, makes actions on them, and publishes the results.

`node` publishes the parts of a folder, and `actions` serves drop_part and reorient_part.
"""
