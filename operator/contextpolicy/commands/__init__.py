"""One file per subcommand: `add(subparsers)` declares its arguments, `main(arguments)` returns the exit code.

Nothing heavy is imported at the top of these files: `contextpolicy --help` must not load kopf, and `simulate` needs
neither Kubernetes nor Zenoh.
"""
