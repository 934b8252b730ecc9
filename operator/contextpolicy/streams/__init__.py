"""Input: everything that produces samples, live from Zenoh or from timelines in virtual time."""
