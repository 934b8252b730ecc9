"""Policies as files: what the API server and the operator would refuse, told offline with file and line.

Reading order: documents (YAML with positions), crd_schema, crd_words and crd_rules (what only the API server refuses),
overlaps and advice (what is allowed and still wrong), check (all of it).
"""
