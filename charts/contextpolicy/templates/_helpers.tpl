{{/* What the program is called in names and labels. */}}
{{- define "contextpolicy.name" -}}
{{ .Values.nameOverride | default .Chart.Name | trunc 50 | trimSuffix "-" }}
{{- end -}}

{{/* The name that all objects start with. */}}
{{- define "contextpolicy.fullname" -}}
{{- $name := include "contextpolicy.name" . -}}
{{- if .Values.fullnameOverride -}}
{{- .Values.fullnameOverride | trunc 50 | trimSuffix "-" -}}
{{- else if contains $name .Release.Name -}}
{{- .Release.Name | trunc 50 | trimSuffix "-" -}}
{{- else -}}
{{- printf "%s-%s" .Release.Name $name | trunc 50 | trimSuffix "-" -}}
{{- end -}}
{{- end -}}

{{/* What identifies the pods of one component: it can never change. Takes a list: root, component. */}}
{{- define "contextpolicy.selectorLabels" -}}
app.kubernetes.io/name: {{ include "contextpolicy.name" (index . 0) }}
app.kubernetes.io/instance: {{ (index . 0).Release.Name }}
app.kubernetes.io/component: {{ index . 1 }}
{{- end -}}

{{/* The labels of every object. Takes a list: root, component. */}}
{{- define "contextpolicy.labels" -}}
{{- $root := index . 0 -}}
helm.sh/chart: {{ printf "%s-%s" $root.Chart.Name $root.Chart.Version | replace "+" "_" | trunc 63 | trimSuffix "-" }}
{{ include "contextpolicy.selectorLabels" . }}
app.kubernetes.io/part-of: contextpolicy
app.kubernetes.io/version: {{ $root.Chart.AppVersion | quote }}
app.kubernetes.io/managed-by: {{ $root.Release.Service }}
{{- with $root.Values.commonLabels }}
{{ toYaml . }}
{{- end }}
{{- end -}}

{{/* The labels of the pods of one component. Takes a list: root, component. By `part-of` the command line finds them,
whatever the chart's names are overridden with. */}}
{{- define "contextpolicy.podLabels" -}}
{{- $own := (get (index . 0).Values (index . 1) | default dict).podLabels -}}
{{ include "contextpolicy.selectorLabels" . }}
app.kubernetes.io/part-of: contextpolicy
{{- with merge (dict) ($own | default dict) (index . 0).Values.commonLabels }}
{{ toYaml . }}
{{- end }}
{{- end -}}

{{- define "contextpolicy.image" -}}
{{ .Values.image.repository }}:{{ .Values.image.tag | default .Chart.AppVersion }}{{ with .Values.image.digest }}@{{ . }}{{ end }}
{{- end -}}

{{- define "contextpolicy.serviceAccountName" -}}
{{ .Values.serviceAccount.name | default (.Values.serviceAccount.create | ternary (include "contextpolicy.fullname" .) "default") }}
{{- end -}}

{{/* Where operator and agent find Zenoh: the chart's router, or the endpoints given; exactly one of the two. */}}
{{- define "contextpolicy.zenohConnect" -}}
{{- if and .Values.router.enabled .Values.zenoh.connect -}}
{{- fail "zenoh.connect names a router that already runs, so set router.enabled=false; or leave zenoh.connect empty to run one" -}}
{{- else if .Values.router.enabled -}}
{{- $host := .Values.router.service.clusterIP | default (printf "%s-router.%s" (include "contextpolicy.fullname" .) .Release.Namespace) -}}
{{ include "contextpolicy.secured" . | empty | ternary "tcp" "tls" }}/{{ contains ":" $host | ternary (printf "[%s]" $host) $host }}:{{ .Values.router.port }}
{{- else if .Values.zenoh.connect -}}
{{ join "," .Values.zenoh.connect }}
{{- else -}}
{{- fail "no Zenoh router: set router.enabled=true to run one, or zenoh.connect to use another" -}}
{{- end -}}
{{- end -}}

{{/* Whether the chart's router asks who speaks: always where an agent acts on what it hears. */}}
{{- define "contextpolicy.secured" -}}
{{- if and .Values.agent.enabled .Values.router.enabled (not .Values.security.enabled) -}}
{{- fail "the agent carries out what it receives on the bus, so it needs security.enabled=true; or set agent.enabled=false" -}}
{{- end -}}
{{- if and .Values.router.enabled .Values.security.enabled -}}true{{- end -}}
{{- end -}}

{{/* Where the fleet's router is; nothing where there is none. */}}
{{- define "contextpolicy.uplink" -}}
{{- if .Values.router.uplink -}}
{{- if not (and (include "contextpolicy.secured" .) .Values.security.routerSecret) -}}
{{- fail "router.uplink joins a fleet's router, which identifies robots by their certificates: set security.enabled=true and name a Secret of the fleet's authority in security.routerSecret, or leave router.uplink empty" -}}
{{- end -}}
{{ join "," .Values.router.uplink }}
{{- end -}}
{{- end -}}

{{/* Whether the chart makes the certificates: all of them are of one authority, so all are brought or none. */}}
{{- define "contextpolicy.makesCertificates" -}}
{{- $brought := .Values.security -}}
{{- $needed := list $brought.routerSecret $brought.operatorSecret -}}
{{- if .Values.agent.enabled -}}{{- $needed = append $needed $brought.agentSecret -}}{{- end -}}
{{- if not (compact $needed) -}}
true
{{- else if has "" $needed -}}
{{- fail "set security.routerSecret, security.operatorSecret and, with the agent, security.agentSecret, or none of them: the same authority must sign all certificates" -}}
{{- end -}}
{{- end -}}

{{/* By namespace, the names of the Secrets that the chart's Job fills, as JSON: none where all are brought. */}}
{{- define "contextpolicy.issuedSecrets" -}}
{{- $prefix := include "contextpolicy.fullname" . -}}
{{- $own := list -}}
{{- $issued := dict -}}
{{- if include "contextpolicy.issuesBus" . -}}
{{- range list "authority" "router" "sensor" "module" "operator" "agent" "viewer" -}}
{{- $own = append $own (printf "%s-bus-%s" $prefix .) -}}
{{- end -}}
{{- range without .Values.security.namespaces .Release.Namespace -}}
{{- $_ := set $issued . (list (printf "%s-bus-sensor" $prefix) (printf "%s-bus-module" $prefix)) -}}
{{- end -}}
{{- end -}}
{{- if include "contextpolicy.issuesSigning" . -}}
{{- $own = append $own (include "contextpolicy.signingSecret" .) -}}
{{- end -}}
{{- if $own -}}
{{- $_ := set $issued .Release.Namespace $own -}}
{{- end -}}
{{- $issued | toJson -}}
{{- end -}}

{{/* Whether the chart makes the certificates of its router and the roles. */}}
{{- define "contextpolicy.issuesBus" -}}
{{- if and (include "contextpolicy.secured" .) (include "contextpolicy.makesCertificates" .) -}}true{{- end -}}
{{- end -}}

{{/* Whether it makes the key of the plans. */}}
{{- define "contextpolicy.issuesSigning" -}}
{{- if and .Values.agent.enabled (not .Values.security.signingSecret) -}}true{{- end -}}
{{- end -}}

{{/* The pod that creates them: the same at the installation and on a schedule. */}}
{{- define "contextpolicy.certificatesPodTemplate" -}}
{{- $arguments := list "certificates" (printf "--release=%s/%s" .Release.Namespace (include "contextpolicy.fullname" .)) -}}
{{- if include "contextpolicy.issuesBus" . -}}
{{- range include "contextpolicy.routerNames" . | fromJsonArray -}}
{{- $arguments = append $arguments (printf "--router-name=%s" .) -}}
{{- end -}}
{{- range .Values.security.namespaces -}}
{{- $arguments = append $arguments (printf "--share=%s" .) -}}
{{- end -}}
{{- else -}}
{{- $arguments = append $arguments "--no-bus" -}}
{{- end -}}
{{- if not (include "contextpolicy.issuesSigning" .) -}}
{{- $arguments = append $arguments "--no-signing" -}}
{{- end -}}
metadata:
  labels:
    {{- include "contextpolicy.podLabels" (list . "certificates") | nindent 4 }}
spec:
  {{- include "contextpolicy.oncePodSpec" (list . "certificates" $arguments) | trim | nindent 2 }}
{{- end -}}

{{/* The Secret with which a component authenticates on the bus; empty where the bus is open. Takes a list: root, role. */}}
{{- define "contextpolicy.busSecret" -}}
{{- $root := index . 0 -}}
{{- $role := index . 1 -}}
{{- with get $root.Values.security (printf "%sSecret" $role) -}}
{{ . }}
{{- else -}}
{{- if include "contextpolicy.secured" $root -}}{{ include "contextpolicy.fullname" $root }}-bus-{{ $role }}{{- end -}}
{{- end -}}
{{- end -}}

{{/* The Secret with the key of the plans. */}}
{{- define "contextpolicy.signingSecret" -}}
{{ .Values.security.signingSecret | default (printf "%s-signing" (include "contextpolicy.fullname" .)) }}
{{- end -}}

{{/* The names and addresses in the router's certificate, as JSON: what its clients connect to. */}}
{{- define "contextpolicy.routerNames" -}}
{{- $service := printf "%s-router" (include "contextpolicy.fullname" .) -}}
{{- $local := printf "%s.%s" $service .Release.Namespace -}}
{{- $own := list $service $local (printf "%s.svc" $local) (printf "%s.svc.cluster.local" $local) "localhost" "127.0.0.1" "::1" -}}
{{- concat $own (compact (list .Values.router.service.clusterIP)) .Values.security.routerNames | uniq | toJson -}}
{{- end -}}

{{/* The environment, mounts and volumes of a component: its Secrets and its extras. Each takes a list: root, role. */}}
{{- define "contextpolicy.environment" -}}
{{- if include "contextpolicy.busSecret" . }}
- name: ZENOH_CREDENTIALS
  value: /etc/contextpolicy/bus
{{- end }}
{{- if and (index . 0).Values.agent.enabled (ne (index . 1) "router") }}
- name: PLAN_SIGNING
  value: /etc/contextpolicy/signing
{{- end }}
{{- with (get (index . 0).Values (index . 1)).extraEnv }}
{{ toYaml . }}
{{- end }}
{{- end -}}

{{- define "contextpolicy.mounts" -}}
{{- if include "contextpolicy.busSecret" . }}
- name: bus
  mountPath: /etc/contextpolicy/bus
  readOnly: true
{{- end }}
{{- if and (index . 0).Values.agent.enabled (ne (index . 1) "router") }}
- name: signing
  mountPath: /etc/contextpolicy/signing
  readOnly: true
{{- end }}
{{- with (get (index . 0).Values (index . 1)).extraVolumeMounts }}
{{ toYaml . }}
{{- end }}
{{- end -}}

{{- define "contextpolicy.volumes" -}}
{{- $root := index . 0 -}}
{{- with include "contextpolicy.busSecret" . }}
- name: bus
  secret:
    secretName: {{ . }}
    {{- if include "contextpolicy.issuesBus" $root }}
    # The pod waits until they are there.
    items:
    - {key: ca.crt, path: ca.crt}
    - {key: tls.crt, path: tls.crt}
    - {key: tls.key, path: tls.key}
    {{- end }}
{{- end }}
{{- if and (index . 0).Values.agent.enabled (ne (index . 1) "router") }}
- name: signing
  secret:
    secretName: {{ include "contextpolicy.signingSecret" (index . 0) }}
    items:
    - {key: tls.crt, path: tls.crt}
    # Agents don't get the key: an attacker on one node must not be able to publish plans for the others.
    {{- if ne (index . 1) "agent" }}
    - {key: tls.key, path: tls.key}
    {{- end }}
{{- end }}
{{- with (get (index . 0).Values (index . 1)).extraVolumes }}
{{ toYaml . }}
{{- end }}
{{- end -}}

{{/* Passes the restricted Pod Security Standard. */}}
{{- define "contextpolicy.podSecurityContext" -}}
runAsNonRoot: true
{{- with .Values.podSecurity.runAsUser }}
runAsUser: {{ . }}
{{- end }}
{{- with .Values.podSecurity.runAsGroup }}
runAsGroup: {{ . }}
{{- end }}
{{- with .Values.podSecurity.seLinuxOptions }}
seLinuxOptions:
  {{- toYaml . | nindent 2 }}
{{- end }}
seccompProfile:
  type: RuntimeDefault
{{- end -}}

{{- define "contextpolicy.containerSecurityContext" -}}
allowPrivilegeEscalation: false
readOnlyRootFilesystem: true
capabilities:
  drop: [ALL]
{{- end -}}

{{/* How a pod is placed. Takes the component's values. */}}
{{- define "contextpolicy.placement" -}}
{{- with .priorityClassName }}
priorityClassName: {{ . }}
{{- end }}
{{- with .nodeSelector }}
nodeSelector:
  {{- toYaml . | nindent 2 }}
{{- end }}
{{- with .tolerations }}
tolerations:
  {{- toYaml . | nindent 2 }}
{{- end }}
{{- with .affinity }}
affinity:
  {{- toYaml . | nindent 2 }}
{{- end }}
{{- end -}}

{{/* Renders nothing; fails when two of the operator's servers would listen on the same port. */}}
{{- define "contextpolicy.checkPorts" -}}
{{- $ports := list (int .Values.operator.healthPort) (int .Values.metrics.port) (int .Values.operator.livePort) -}}
{{- if and .Values.router.enabled (eq (int .Values.router.port) (int .Values.metrics.port)) -}}
{{- fail (printf "router.port and metrics.port are both %d but must differ: the router listens on both" (int .Values.router.port)) -}}
{{- end -}}
{{- if lt (len (uniq $ports)) 3 -}}
{{- fail (printf "operator.healthPort %d, metrics.port %d and operator.livePort %d must differ: the operator listens on all of them" (index $ports 0) (index $ports 1) (index $ports 2)) -}}
{{- end -}}
{{- end -}}

{{/* How a component's pods are spread. Takes a list: root, component, what holds where the values say nothing. */}}
{{- define "contextpolicy.spread" -}}
{{- $own := dict "labelSelector" (dict "matchLabels" (include "contextpolicy.selectorLabels" . | fromYaml)) -}}
{{- with (get (index . 0).Values (index . 1)).topologySpreadConstraints | default (index . 2) }}
topologySpreadConstraints:
{{- range . }}
- {{ if hasKey . "labelSelector" }}{{ toYaml . | nindent 2 | trim }}{{ else }}{{ merge (dict) . $own | toYaml | nindent 2 | trim }}{{ end }}
{{- end }}
{{- end }}
{{- end -}}

{{/* All that the operator does in a namespace. */}}
{{- define "contextpolicy.namespacedRules" -}}
# Policies are read; patched for the finalizer that lets the operator restore containers before a policy goes.
- apiGroups: [contextpolicy.dev]
  resources: [contextpolicies]
  verbs: [list, watch, patch]
- apiGroups: [contextpolicy.dev]
  resources: [contextpolicies/status]
  verbs: [patch]
# Pods are found by label. What their containers had before is kept in the policies' status.
- apiGroups: [""]
  resources: [pods]
  verbs: [get, list, watch]
# The plan itself: CPU of running containers, nothing else can be changed through it.
- apiGroups: [""]
  resources: [pods/resize]
  verbs: [patch]
- apiGroups: [""]
  resources: [events]
  verbs: [create]
# The Lease that says which release serves the namespace; one that is created can't be named here.
- apiGroups: [coordination.k8s.io]
  resources: [leases]
  resourceNames: [contextpolicy]
  verbs: [get, update]
- apiGroups: [coordination.k8s.io]
  resources: [leases]
  verbs: [create]
# What a pod had before, where its status does not say so beyond doubt.
- apiGroups: [apps]
  resources: [replicasets, statefulsets, daemonsets]
  verbs: [get]
- apiGroups: [batch]
  resources: [jobs]
  verbs: [get]
{{- with .Values.rosTypes }}
# Definitions of the robot's own ROS 2 messages, which policies name; no other ConfigMap can be read.
- apiGroups: [""]
  resources: [configmaps]
  resourceNames: {{ toJson . }}
  verbs: [get]
{{- end }}
{{- end -}}

{{/* What the release calls itself in the Leases of namespaces, and the Lease of its replicas: namespace/name. */}}
{{- define "contextpolicy.lease" -}}
{{ .Release.Namespace }}/{{ include "contextpolicy.fullname" . }}
{{- end -}}

{{/* The Secret with the key that signs what containers had before. */}}
{{- define "contextpolicy.originalsSecret" -}}
{{ include "contextpolicy.fullname" . }}-originals
{{- end -}}

{{/* Whether uninstalling puts containers back; without rights the Job could do nothing. */}}
{{- define "contextpolicy.restores" -}}
{{- if and .Values.restoreOnUninstall .Values.rbac.create -}}true{{- end -}}
{{- end -}}

{{/* The annotations of what exists only while the release is uninstalled. Takes the weight: low ones come first. */}}
{{- define "contextpolicy.uninstallHook" -}}
helm.sh/hook: post-delete
helm.sh/hook-weight: {{ . | quote }}
helm.sh/hook-delete-policy: hook-succeeded,before-hook-creation
{{- end -}}

{{/* The namespaces that are served as arguments, as JSON; none means all. */}}
{{- define "contextpolicy.namespaceArguments" -}}
{{- $arguments := list -}}
{{- range .Values.watchNamespaces -}}
{{- $arguments = append $arguments (printf "--namespace=%s" .) -}}
{{- end -}}
{{- $arguments | toJson -}}
{{- end -}}

{{/* The pod of something that is done once, with the account of the same name. Takes a list: root, component, arguments. */}}
{{- define "contextpolicy.oncePodSpec" -}}
{{- $root := index . 0 -}}
{{- with $root.Values.imagePullSecrets }}
imagePullSecrets:
  {{- toYaml . | nindent 2 }}
{{- end }}
serviceAccountName: {{ include "contextpolicy.fullname" $root }}-{{ index . 1 }}
enableServiceLinks: false
restartPolicy: Never
{{- include "contextpolicy.placement" $root.Values.operator }}
securityContext:
  {{- include "contextpolicy.podSecurityContext" $root | nindent 2 }}
containers:
- name: {{ index . 1 }}
  image: {{ include "contextpolicy.image" $root }}
  imagePullPolicy: {{ $root.Values.image.pullPolicy }}
  args:
  {{- toYaml (index . 2) | nindent 2 }}
  resources:
    {{- toYaml $root.Values.operator.resources | nindent 4 }}
  securityContext:
    {{- include "contextpolicy.containerSecurityContext" $root | nindent 4 }}
{{- end -}}

{{/* A NetworkPolicy's spec: the pods of a component reach the API server and nothing else. Takes a list: root, component. */}}
{{- define "contextpolicy.reachesOnlyTheApi" -}}
podSelector:
  matchLabels:
    {{- include "contextpolicy.selectorLabels" . | nindent 4 }}
policyTypes: [Ingress, Egress]
ingress: []
egress:
- ports:
  {{- range (index . 0).Values.networkPolicy.apiServerPorts }}
  - port: {{ . }}
  {{- end }}
{{- end -}}

{{/* The annotations of what exists only during `helm test`. Takes the weight: low ones come first. */}}
{{- define "contextpolicy.testHook" -}}
helm.sh/hook: test
helm.sh/hook-weight: {{ . | quote }}
helm.sh/hook-delete-policy: hook-succeeded,hook-failed,before-hook-creation
{{- end -}}

{{/* What the agent may do on its node, and its supervisor, which undoes the same. */}}
{{- define "contextpolicy.agentSecurity" -}}
# The cgroup files and the state directory belong to root and only their owner may write them. That is all
# root is needed for: no capability goes with it, so it can neither override file rights (DAC_OVERRIDE) nor
# mount or trace anything. Watching for other writers (inotify) needs no more than read access to the file.
runAsUser: 0
runAsGroup: 0
allowPrivilegeEscalation: false
readOnlyRootFilesystem: true
capabilities:
  drop: [ALL]
  {{- if .Values.agent.realtime }}
  # Realtime priority, for the threads of other users' processes.
  add: [SYS_NICE]
  {{- end }}
{{- end -}}
