"""How long a time the fair scheduler serves a thread at once (EEVDF, Linux 6.12): sched_setattr, which Python lacks."""

from __future__ import annotations

import ctypes
import os

_SETATTR = 314
"""The system call's number on x86-64; 274 on arm64."""


class _Attributes(ctypes.Structure):
    _fields_ = (
        ("size", ctypes.c_uint32),
        ("policy", ctypes.c_uint32),
        ("flags", ctypes.c_uint64),
        ("nice", ctypes.c_int32),
        ("priority", ctypes.c_uint32),
        ("runtime", ctypes.c_uint64),
        ("deadline", ctypes.c_uint64),
        ("period", ctypes.c_uint64),
    )


def ask_for_slice(process: int, seconds: float) -> None:
    """Ask for a slice, 0.1 to 100 ms; OSError where the kernel refuses."""
    attributes = _Attributes(size=ctypes.sizeof(_Attributes), policy=os.SCHED_OTHER, runtime=round(seconds * 1e9))
    number = {"x86_64": _SETATTR, "aarch64": 274}[os.uname().machine]
    if ctypes.CDLL(None, use_errno=True).syscall(number, process, ctypes.byref(attributes), 0):
        error = ctypes.get_errno()
        raise OSError(error, f"no slice of its own for process {process}: {os.strerror(error)}")
