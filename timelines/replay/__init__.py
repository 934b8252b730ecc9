"""Plays timelines on the robot's bus in real time."""
