"""A feeder, a robot and a camera without hardware: images out, advice in.

`node` first has what follows the part and the answers and makes messages, then the cycle: image,
advice, picks, action of the feeder.
"""
