"""A vision system for a feeder, to copy: images in, detections out.

`contours` finds the outlines in an image with OpenCV, and `node` lets the service identify_part
tell what they show.
"""
