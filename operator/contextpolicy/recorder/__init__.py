"""The flight recorder: the last minutes of each policy's samples and plans, in bounded memory, to be replayed later."""
