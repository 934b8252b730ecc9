#!/bin/sh
# Tries contextpolicy on a robot, or on another computer with Debian or Ubuntu, root and internet: installs k3s and helm,
# builds the images, runs the demo, and writes what it saw to build/try/report.txt. Please send that file back.
#
#     sudo config/k3s/try.sh
#
# It changes what k3s's own installer changes, and ends with k3s running; /usr/local/bin/k3s-uninstall.sh takes it away.
set -eu
cd "$(dirname "$0")/../.."
report=build/try/report.txt

apt-get update -qq
apt-get install -qq --no-install-recommends ca-certificates curl git make python3-venv
python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    echo "$0: Python 3.11 or newer is needed, as Debian 12 and Ubuntu 24.04 have it; this is $(python3 --version)" >&2
    exit 1
}

# k3s reads these when it starts: what must not be there for resizes to work, and how soon a container starts again.
install -D -m 644 config/k3s/config.yaml /etc/rancher/k3s/config.yaml
install -D -m 644 config/k3s/kubelet.conf /var/lib/rancher/k3s/agent/etc/kubelet.conf.d/90-contextpolicy.conf
command -v k3s >/dev/null || curl -sfL https://get.k3s.io | INSTALL_K3S_CHANNEL=v1.36 sh -
command -v helm >/dev/null || curl -sfL https://raw.githubusercontent.com/helm/helm/main/scripts/get-helm-4 | bash
systemctl restart k3s

export KUBECONFIG=/etc/rancher/k3s/k3s.yaml
timeout 600 sh -c 'until k3s kubectl wait --for=condition=Ready node --all --timeout=60s; do sleep 2; done'
# The commands that the demo uses have their usual names.
command -v kubectl >/dev/null || ln -s "$(command -v k3s)" /usr/local/bin/kubectl

mkdir -p build/try
{
    date
    tr -d '\0' 2>/dev/null </proc/device-tree/model || grep -m 1 'model name' /proc/cpuinfo || true
    echo
    uname -a
    nproc
    k3s --version
    echo "cgroups: $(stat --file-system --format=%T /sys/fs/cgroup)"
    git log -1 --format='contextpolicy %h' || true
} >"$report" 2>&1

status=0
make demo >build/try/demo.log 2>&1 || status=$?
cat build/try/demo.log >>"$report"
echo "the demo ended with $status; the report is $report"
exit "$status"
