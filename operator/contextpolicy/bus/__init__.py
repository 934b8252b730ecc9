"""The robot's bus: the Zenoh session, and the decision bus with everything said, heard and shown on it.

Zenoh's callbacks must neither call Zenoh nor block, so they hand everything they receive to the loop.
"""
