"""What is decided about a shadow: how its plans differ, and whether it may stay promoted. Pure."""
