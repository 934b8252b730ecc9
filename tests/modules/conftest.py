"""The machine that runs the tests may be busy: an example that took long is no failure."""

from hypothesis import settings

settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")
