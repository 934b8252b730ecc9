"""Who is who in the cluster: an authority, a certificate for each caller, the key that signs tokens."""

from __future__ import annotations

from dataclasses import dataclass

from tests.node.layout import API_SERVICE_ADDRESS, NODE_ADDRESS, NODE_NAME, PKI
from tests.node.shell import run

DAYS = "3650"
AUTHORITY = "authority"
TOKENS = "tokens"


@dataclass(frozen=True)
class Identity:
    """A user and a group as the API server reads them: common name and organisation."""

    name: str
    user: str
    group: str = ""
    alternative_names: tuple[str, ...] = ()


API_SERVER = Identity(
    "apiserver",
    "kube-apiserver",
    alternative_names=(
        f"IP:{NODE_ADDRESS}",
        f"IP:{API_SERVICE_ADDRESS}",
        "IP:127.0.0.1",
        "DNS:kubernetes",
        "DNS:kubernetes.default",
        "DNS:kubernetes.default.svc",
        "DNS:kubernetes.default.svc.cluster.local",
        f"DNS:{NODE_NAME}",
    ),
)
API_SERVER_AS_CLIENT = Identity("apiserver-client", "kube-apiserver-kubelet-client", "system:masters")
ADMIN = Identity("admin", "admin", "system:masters")
CONTROLLER_MANAGER = Identity("controller-manager", "system:kube-controller-manager")
SCHEDULER = Identity("scheduler", "system:kube-scheduler")
KUBELET = Identity("kubelet", f"system:node:{NODE_NAME}", "system:nodes")
PROXY = Identity("proxy", "system:kube-proxy")
CLIENTS = (ADMIN, CONTROLLER_MANAGER, SCHEDULER, KUBELET, PROXY)


def certificate(name: str) -> str:
    return str(PKI / f"{name}.crt")


def private_key(name: str) -> str:
    return str(PKI / f"{name}.key")


def create() -> None:
    """Create what is missing: a node that comes back after a reboot keeps its identities."""
    PKI.mkdir(mode=0o700, parents=True, exist_ok=True)
    if (PKI / f"{TOKENS}.key").exists():
        return
    usage = "keyUsage=critical,keyCertSign,cRLSign"
    run([*_request(AUTHORITY, "/CN=contextpolicy-node-ca"), "-addext", usage])
    for identity in (API_SERVER, API_SERVER_AS_CLIENT, *CLIENTS):
        run(issue(identity))
    run(["openssl", "genrsa", "-out", private_key(TOKENS), "2048"])
    run(["openssl", "rsa", "-in", private_key(TOKENS), "-pubout", "-out", certificate(TOKENS)])


def issue(identity: Identity) -> list[str]:
    """Return the command that creates a key and a certificate signed by the authority."""
    subject = (f"/O={identity.group}" if identity.group else "") + f"/CN={identity.user}"
    names = ",".join(identity.alternative_names)
    usage = "serverAuth" if names else "clientAuth"
    extensions = [f"extendedKeyUsage={usage}", "basicConstraints=critical,CA:FALSE"]
    extensions += [f"subjectAltName={names}"] if names else []
    added = [part for extension in extensions for part in ("-addext", extension)]
    signed = ["-CA", certificate(AUTHORITY), "-CAkey", private_key(AUTHORITY)]
    return [*_request(identity.name, subject), *signed, *added]


def _request(name: str, subject: str) -> list[str]:
    key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"]
    files = ["-keyout", private_key(name), "-out", certificate(name)]
    return ["openssl", "req", "-x509", *key, "-days", DAYS, "-subj", subject, *files]
