"""What can go wrong, by what follows from it.

ConfigurationError      at the start, the program ends with one clear line and exit code 2
MessageError            one sample is dropped and counted, the module goes on
DeviceError             the module tells it and tries again, ever more rarely, until the device is back
any other exception     the module ends loudly, and Kubernetes restarts it
"""


class ConfigurationError(Exception):
    """The module.yaml, the environment or a file that it names makes no sense; the message says what is allowed."""


class MessageError(Exception):
    """A payload that is not what its key promises."""


class DeviceError(Exception):
    """A device that is missing, unplugged or does not answer."""
