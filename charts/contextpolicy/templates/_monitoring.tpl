{{/* A file with the label that says which robot a series is of. Takes a list: root, file. */}}
{{- define "contextpolicy.withRobotLabel" -}}
{{- $root := index . 0 -}}
{{ regexReplaceAllLiteral "\\bcluster\\b" ($root.Files.Get (index . 1)) $root.Values.metrics.robot.label }}
{{- end -}}

{{/* The rules of files/alerts.yaml with what metrics.alerts says about them, and that of files/expected.yaml for this release. */}}
{{- define "contextpolicy.alerts" -}}
{{- $file := include "contextpolicy.withRobotLabel" (list . "files/alerts.yaml") | fromYaml -}}
{{- range $group := $file.groups -}}
{{- $rules := list -}}
{{- range $rule := $group.rules -}}
{{- $own := get $.Values.metrics.alerts.rules $rule.alert | default dict -}}
{{- if ne (get $own "enabled" | toString) "false" -}}
{{- with $own.for }}{{ $_ := set $rule "for" . }}{{ end -}}
{{- with $own.severity }}{{ $_ := set $rule.labels "severity" . }}{{ end -}}
{{- if hasKey $own "threshold" }}{{ $_ := set $rule "expr" (regexReplaceAll "[0-9.]+$" $rule.expr (toString $own.threshold)) }}{{ end -}}
{{- $_ := set $rule.annotations "runbook_url" (regexReplaceAllLiteral "^[^#]*" $rule.annotations.runbook_url $.Values.metrics.alerts.runbookUrl) -}}
{{- $rules = append $rules $rule -}}
{{- end -}}
{{- end -}}
{{- $_ := set $group "rules" $rules -}}
{{- end -}}
{{- $expected := $.Files.Get "files/expected.yaml" | fromYaml -}}
{{- $labels := dict "namespace" $.Release.Namespace -}}
{{- with $.Values.metrics.robot.name }}{{ $_ := set $labels $.Values.metrics.robot.label . }}{{ end -}}
{{- range $group := $expected.groups -}}
{{- range $rule := $group.rules }}{{ $_ := set $rule "labels" $labels }}{{ end -}}
{{- end -}}
{{ toYaml (dict "groups" (concat $file.groups $expected.groups)) }}
{{- end -}}
