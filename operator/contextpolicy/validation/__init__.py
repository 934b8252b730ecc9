"""Policies as files: what the API server and the operator would refuse, told offline with file and line.

Reading order: documents (YAML with positions), api (what only the API server refuses), claims and advice (what is
allowed and still wrong), check (all of it).
"""
