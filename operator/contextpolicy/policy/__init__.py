"""The user's policy as values, and everything that can be checked offline. No state, no clock, no network.

Reading order: spec (the values), fields and quantities (how one field is read), parsing (a whole object), cel
with cel_functions, cel_syntax, cel_cost, cel_numbers and cel_rewriting (expressions: the table of functions, the tree,
what they may cost, what a number is, and the text for the CEL library), references (what only the whole policy can
show).
"""
