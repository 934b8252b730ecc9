"""Reporting only: status, events, metrics and logs say what was decided and why, and change nothing."""
