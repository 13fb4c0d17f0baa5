"""A feeder, a robot and a camera without hardware: images out, advice in.

`truth` follows what is known of the part, `messages` makes the messages, and `node` runs the
cycle: image, advice, picks, action of the feeder.
"""
