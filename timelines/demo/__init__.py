"""The main job shown on a real node: a timeline moves CPU between running pods, and the kernel's files prove it.

`deploy` installs everything with the user's own tools (helm, kubectl), `cgroup` reads what the kernel enforces,
`recorder` records it while the timeline plays, `view` shows it live, `verdict` judges the result.
"""
