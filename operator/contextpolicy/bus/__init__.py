"""The robot's bus: the Zenoh session, and the decision bus with everything published, received and shown on it.

Zenoh's callbacks must neither call Zenoh nor block, so they hand everything they receive to the loop.
"""
