#!/bin/sh
# What a job of helm-controller is asked to do: `install ARGUMENT...` with the chart in /chart and values in /config, or
# `delete`. NAME and TARGET_NAMESPACE are in the environment; only /tmp can be written.
set -eu
export HOME=/tmp
action=$1
shift
if [ "$action" = delete ]; then
    exec helm uninstall "$NAME" --namespace "$TARGET_NAMESPACE" --ignore-not-found --wait --timeout 120s
fi
base64 --decode "/chart/$NAME.tgz.base64" >/tmp/chart.tgz
for values in /config/values-*.yaml; do
    set -- "$@" --values "$values"
done
exec helm upgrade --install "$NAME" /tmp/chart.tgz "$@" --wait --timeout 120s
