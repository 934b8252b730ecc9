"""The page of metrics of a pod, as Prometheus scrapes it."""

from __future__ import annotations

import re
import urllib.request

from tests.e2e.cluster import run


def address(component: str, release: str = "e2e", system: str = "e2e-system") -> str:
    """The address of a pod of this component."""
    selector = f"app.kubernetes.io/instance={release},app.kubernetes.io/component={component}"
    return run("kubectl", "get", "pods", "-n", system, "-l", selector, "-o", "jsonpath={.items[0].status.podIP}")


def scrape(component: str, release: str = "e2e", system: str = "e2e-system") -> str:
    """What the pod exports."""
    with urllib.request.urlopen(f"http://{address(component, release, system)}:8081/metrics", timeout=30) as page:
        text: str = page.read().decode()
        return text


def series(text: str) -> set[str]:
    """The names of the operator's own series on a page."""
    return set(re.findall(r"^(contextpolicy_[a-z_]+)", text, flags=re.MULTILINE))
