"""What a person wrote, as values, and everything that can be said about it offline. No state, no clock, no network.

Reading order: spec (the values), fields and quantities (how one field is read), parsing (a whole object), cel and
cel_syntax (expressions and what they may cost), references (what only the whole policy can tell).
"""
