"""The cluster as values, and the one door to its API.

`pods`, `claims` and `events` are pure; `api` alone talks to the API server and turns its answers into our errors.
"""
