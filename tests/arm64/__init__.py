"""The operator's image for arm64, started under emulation and compared with the one for this machine."""
