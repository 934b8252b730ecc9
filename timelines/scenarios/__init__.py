"""Timelines from readable scenarios: a YAML file says what the robot does, hears and sees; the JSON follows from it.

`scenario.py` is the file as values, `inputs.py` turns it into a timeline, and `timelines.datasets` makes the recordings
that the timeline names. The same scenario always gives the same timeline.
"""
