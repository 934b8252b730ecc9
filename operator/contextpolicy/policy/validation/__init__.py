"""Offline checks of policy files: everything the API server or the operator would refuse, with file and line.

Reading order: documents (YAML with positions), crd_schema, crd_words and crd_rules (what only the API server refuses),
overlaps and advice (what is allowed but wrong), check (all of it).
"""
