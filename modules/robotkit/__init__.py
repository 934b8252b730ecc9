"""What every module needs and none should write again: bus session, inputs, outputs, the policy's decisions, the loop.

Two rules are built in. A task that gets no CPU never stalls the sensor that feeds it: inputs keep only the newest
samples and count what they drop, outputs are dropped rather than waited for. A suspended task takes no input at all.
"""
