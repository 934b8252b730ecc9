"""The commands."""

KEYWORDS = ("forward", "backward", "left", "right", "stop")
