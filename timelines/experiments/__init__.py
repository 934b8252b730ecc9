"""The paper's experiments (section VI) on a real node: one timeline under every way to divide the CPU, compared."""
