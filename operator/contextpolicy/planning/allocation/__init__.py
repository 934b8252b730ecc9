"""Who gets what: scores become weights, and these the shares of each node (Eqs. 1 and 2 of the paper).

Reading order: placement, seating, bounds, weights, shares, division, feasibility, decision, plan.
"""
