"""Output: carries out plans. `actuator` is the contract; `app/wiring.py` registers one actuator for each mode."""
