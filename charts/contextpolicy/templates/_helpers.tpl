{{/* The name that all objects start with. */}}
{{- define "contextpolicy.fullname" -}}
{{- if .Values.fullnameOverride -}}
{{- .Values.fullnameOverride | trunc 50 | trimSuffix "-" -}}
{{- else if contains .Chart.Name .Release.Name -}}
{{- .Release.Name | trunc 50 | trimSuffix "-" -}}
{{- else -}}
{{- printf "%s-%s" .Release.Name .Chart.Name | trunc 50 | trimSuffix "-" -}}
{{- end -}}
{{- end -}}

{{/* What identifies the pods of one component: it can never change. Takes a list: root, component. */}}
{{- define "contextpolicy.selectorLabels" -}}
app.kubernetes.io/name: {{ (index . 0).Chart.Name }}
app.kubernetes.io/instance: {{ (index . 0).Release.Name }}
app.kubernetes.io/component: {{ index . 1 }}
{{- end -}}

{{/* The labels of every object. Takes a list: root, component. */}}
{{- define "contextpolicy.labels" -}}
{{- $root := index . 0 -}}
helm.sh/chart: {{ printf "%s-%s" $root.Chart.Name $root.Chart.Version | replace "+" "_" | trunc 63 | trimSuffix "-" }}
{{ include "contextpolicy.selectorLabels" . }}
app.kubernetes.io/version: {{ $root.Chart.AppVersion | quote }}
app.kubernetes.io/managed-by: {{ $root.Release.Service }}
{{- with $root.Values.commonLabels }}
{{ toYaml . }}
{{- end }}
{{- end -}}

{{/* The labels of the pods of one component. Takes a list: root, component. */}}
{{- define "contextpolicy.podLabels" -}}
{{ include "contextpolicy.selectorLabels" . }}
{{- with (index . 0).Values.commonLabels }}
{{ toYaml . }}
{{- end }}
{{- end -}}

{{- define "contextpolicy.image" -}}
{{ .Values.image.repository }}:{{ .Values.image.tag | default .Chart.AppVersion }}
{{- end -}}

{{- define "contextpolicy.serviceAccountName" -}}
{{ .Values.serviceAccount.name | default (include "contextpolicy.fullname" .) }}
{{- end -}}

{{/* Where operator and agent find Zenoh: the chart's router, or the endpoints given; exactly one of the two. */}}
{{- define "contextpolicy.zenohConnect" -}}
{{- if and .Values.router.enabled .Values.zenoh.connect -}}
{{- fail "zenoh.connect names a router that already runs, so set router.enabled=false; or leave zenoh.connect empty to run one" -}}
{{- else if .Values.router.enabled -}}
{{- $host := .Values.router.service.clusterIP | default (printf "%s-router.%s" (include "contextpolicy.fullname" .) .Release.Namespace) -}}
tcp/{{ contains ":" $host | ternary (printf "[%s]" $host) $host }}:{{ .Values.router.port }}
{{- else if .Values.zenoh.connect -}}
{{ join "," .Values.zenoh.connect }}
{{- else -}}
{{- fail "there is no Zenoh router to listen to: set router.enabled=true to run one, or name one with zenoh.connect" -}}
{{- end -}}
{{- end -}}

{{/* Passes the restricted Pod Security Standard. */}}
{{- define "contextpolicy.podSecurityContext" -}}
runAsNonRoot: true
runAsUser: 65532
runAsGroup: 65532
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

{{/* All that the operator does in a namespace. */}}
{{- define "contextpolicy.namespacedRules" -}}
# Policies are read; patched for the finalizer that lets the operator restore containers before a policy goes.
- apiGroups: [contextpolicy.dev]
  resources: [contextpolicies]
  verbs: [get, list, watch, patch]
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
{{- with .Values.rosTypes }}
# Definitions of the robot's own ROS 2 messages, which policies name; no other ConfigMap can be read.
- apiGroups: [""]
  resources: [configmaps]
  resourceNames: {{ toJson . }}
  verbs: [get]
{{- end }}
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
