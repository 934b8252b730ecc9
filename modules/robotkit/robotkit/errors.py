"""What can go wrong, by its consequence.

ConfigurationError      at the start, the program ends with one clear line and exit code 2
MessageError            one sample is dropped and counted, the module goes on
DeviceError             the module logs it and retries, with growing pauses, until the device is back
any other exception     the module crashes with a traceback, and Kubernetes restarts it
"""


class ConfigurationError(Exception):
    """The module.yaml, the environment or a file it names is invalid; the message says what is allowed."""


class MessageError(Exception):
    """A payload that is not what its key promises."""


class DeviceError(Exception):
    """A device that is missing, unplugged or does not answer."""
