"""What holds now: samples become stream states, and these the values of activities and contexts.

Reading order: sample, stream, features, scope, expressions, initiative, scores, context, evaluation.
"""
