"""What a version consists of, made of a commit: the image, the chart, what is in them, and a signature."""
