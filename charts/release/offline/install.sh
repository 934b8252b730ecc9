#!/bin/sh
# Installs contextpolicy on a robot that has no network, or upgrades it. Needs helm; options go to it. As root:
#
#     sudo ./install.sh --set agent.enabled=true
#
# A cluster of several nodes needs ./import-images.sh on each of the others first.
set -eu
cd "$(dirname "$0")"
if ! command -v helm >/dev/null; then
    echo "install.sh: helm is not on the PATH: copy its binary to /usr/local/bin" >&2
    exit 2
fi
./import-images.sh

if [ -z "${KUBECONFIG:-}" ] && [ -e /etc/rancher/k3s/k3s.yaml ]; then
    export KUBECONFIG=/etc/rancher/k3s/k3s.yaml
fi
exec helm upgrade --install contextpolicy contextpolicy-*[0-9].tgz --namespace contextpolicy-system --create-namespace \
    --set image.pullPolicy=Never --wait "$@"
