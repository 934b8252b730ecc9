"""A policy against a timeline in virtual time: the planning that also runs on the robot, without a robot or a cluster.

Nothing here does I/O, and time comes from a virtual scheduler only: the same two files always give the same plans.
"""
