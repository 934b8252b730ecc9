"""The cluster as values, and the one door to its API.

`pods`, `nodes`, `claims`, `writers` and `agent_reports` are pure. Only `api` talks to the API server, and turns its
answers into our errors; `watching` follows lists through it.
"""
