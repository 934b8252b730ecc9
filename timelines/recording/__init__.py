"""Writes down everything that happens while a timeline plays, as an MCAP file that Foxglove opens."""
