"""The robot's bus: the Zenoh session, and the decision bus: what is said, heard and shown on it.

Zenoh's callbacks must not call Zenoh and must not wait: whatever is heard is handed to the loop.
"""
