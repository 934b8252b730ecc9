"""The program `contextpolicy`, also run as `python -m contextpolicy`."""

import signal
import sys


def main() -> int:
    """Run the command line; returns the exit code.

    While it is loaded, and when it has ended, Ctrl-C ends the process as it ends other programs, without a
    KeyboardInterrupt that nothing would catch. A process that ignores SIGINT keeps ignoring it.
    """
    ours = signal.getsignal(signal.SIGINT)
    if ours is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from contextpolicy import cli  # noqa: PLC0415 - what takes the time

    signal.signal(signal.SIGINT, ours)
    try:
        return cli.main()
    finally:
        if ours is signal.default_int_handler:
            signal.signal(signal.SIGINT, signal.SIG_DFL)


if __name__ == "__main__":
    sys.exit(main())
