"""The live view: the board of each policy as it is now, its last minutes, and the page that shows both.

Read-only, and served on the pod's loopback alone: only users who may port-forward to the operator's pod can reach it.
Kubernetes decides who they are, so there is no login here, and the operator needs no right to review users.
"""
