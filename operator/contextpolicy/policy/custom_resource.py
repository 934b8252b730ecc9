"""How the API server names the custom resource."""

from __future__ import annotations

GROUP, VERSION, PLURAL = "contextpolicy.dev", "v1alpha1", "contextpolicies"
API_VERSION = f"{GROUP}/{VERSION}"
"""`apiVersion` of every policy."""
API = f"/apis/{API_VERSION}"
"""What the resource is served under."""
DEFINITION = f"{PLURAL}.{GROUP}"
"""The name of its definition."""
FINALIZER = f"{GROUP}/restore"
"""Keeps a policy that is being deleted until its containers are restored."""


def path_of(namespace: str, name: str) -> str:
    """A policy's path; both are names as Kubernetes has them, or quoted."""
    return f"{API}/namespaces/{namespace}/{PLURAL}/{name}"
