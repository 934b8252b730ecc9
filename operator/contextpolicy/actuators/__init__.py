"""I/O out: what makes a plan real. `actuator` is the contract; `app/wiring.py` registers one actuator for each mode."""
