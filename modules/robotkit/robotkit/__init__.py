"""What every module needs and none should write again: bus, queues, timing, profile, health, the policy's decisions.

Two rules are built in. A task without CPU never stalls the sensor that feeds it: inputs keep only the newest samples
and count what they drop, and outputs are dropped rather than waited for. A suspended task takes no input at all.

The names below are the whole public interface; the modules behind them may change.
"""

from robotkit.errors import ConfigurationError, DeviceError, MessageError
from robotkit.inputs import Received
from robotkit.main import main
from robotkit.module import Input, Module, Needs, Output, load_module
from robotkit.plan import UNPLANNED, Decision
from robotkit.task import Result, Results, Task

__all__ = [
    "UNPLANNED",
    "ConfigurationError",
    "Decision",
    "DeviceError",
    "Input",
    "MessageError",
    "Module",
    "Needs",
    "Output",
    "Received",
    "Result",
    "Results",
    "Task",
    "load_module",
    "main",
]
