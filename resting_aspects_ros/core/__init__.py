"""What a resting aspect is: parts, rotations, aspects, distributions.

No engine, no files but meshes, no clock.
"""
