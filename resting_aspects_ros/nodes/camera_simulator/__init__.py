"""A feeder, a robot and a camera without hardware: images out, advice in.

`cell` follows what is known of the part and what is answered, and makes the messages; `node` runs
the cycle: image, advice, picks, action of the feeder.
"""
