{{/* `app` is what policies select by. Takes a list: root, module's name. */}}
{{- define "robot.labels" -}}
app: {{ index . 1 }}
app.kubernetes.io/name: {{ index . 1 }}
app.kubernetes.io/instance: {{ (index . 0).Release.Name }}
app.kubernetes.io/part-of: robot
{{- end -}}

{{/* Takes a list: root, module's name. */}}
{{- define "robot.image" -}}
{{- $root := index . 0 -}}
image: {{ $root.Values.image.prefix }}{{ index . 1 }}:{{ $root.Values.image.tag | default $root.Chart.AppVersion }}
imagePullPolicy: {{ $root.Values.image.pullPolicy }}
{{- end -}}

{{/* What a module opens: its guard, else the simulator, else the device. Takes a list: module, device. */}}
{{- define "robot.port" -}}
{{- if (index . 0).guard -}}
tcp://127.0.0.1:4100
{{- else -}}
{{ include "robot.hardware" (index . 1) }}
{{- end -}}
{{- end -}}

{{/* Where the hardware is. Takes the device. */}}
{{- define "robot.hardware" -}}
{{ .simulated | ternary "tcp://127.0.0.1:4000" .path }}
{{- end -}}

{{/* Whether a container touches a real device. Takes a list: module, whether the container is the one to. */}}
{{- define "robot.touches" -}}
{{- $device := (index . 0).device -}}
{{- if and $device (index . 1) (not $device.simulated) -}}true{{- end -}}
{{- end -}}

{{/* The device plugin's resource. Takes the same list. */}}
{{- define "robot.resource" -}}
{{- if include "robot.touches" . -}}
{{- with (index . 0).device.resource -}}
{{ . }}: 1
{{- end -}}
{{- end -}}
{{- end -}}

{{/* A container's rights: a device that no plugin hands out takes a privileged one. Takes the same list. */}}
{{- define "robot.rights" -}}
{{- if and (include "robot.touches" .) (not (index . 0).device.resource) -}}
privileged: true
runAsNonRoot: false
runAsUser: 0
readOnlyRootFilesystem: true
{{- else -}}
allowPrivilegeEscalation: false
readOnlyRootFilesystem: true
capabilities:
  drop: [ALL]
{{- end -}}
{{- end -}}

{{/* Takes a list: root, module, whether the container touches the device. */}}
{{- define "robot.mounts" -}}
{{- $root := index . 0 -}}
{{- $module := index . 1 -}}
{{- if $root.Values.zenoh.secret }}
- {name: bus, mountPath: /etc/robot/bus, readOnly: true}
{{- end }}
{{- if $root.Values.sharedMemory }}
- {name: shm, mountPath: /dev/shm}
{{- end }}
{{- if $module.recordings }}
- {name: recordings, mountPath: /recordings, readOnly: true}
{{- end }}
{{- if $module.scratch }}
- {name: scratch, mountPath: /tmp}
{{- end }}
{{- if and (include "robot.touches" (list $module (index . 2))) (not $module.device.resource) }}
- {name: device, mountPath: {{ $module.device.path }}}
{{- end }}
{{- end -}}

{{/* Takes a list: root, module. */}}
{{- define "robot.volumes" -}}
{{- $root := index . 0 -}}
{{- $module := index . 1 -}}
{{- with $root.Values.zenoh.secret }}
- name: bus
  secret: {secretName: {{ . }}}
{{- end }}
{{- with $root.Values.sharedMemory }}
- name: shm
  # One that the kubelet would make is root's, and modules could not write to it.
  hostPath: {path: {{ . }}, type: Directory}
{{- end }}
{{- if $module.recordings }}
- name: recordings
  {{- with $root.Values.recordings.hostPath }}
  hostPath: {path: {{ . }}, type: Directory}
  {{- else }}
  persistentVolumeClaim: {claimName: {{ $root.Values.recordings.claim }}, readOnly: true}
  {{- end }}
{{- end }}
{{- with $module.scratch }}
- name: scratch
  emptyDir: {medium: Memory, sizeLimit: {{ . }}}
{{- end }}
{{- if and (include "robot.touches" (list $module true)) (not $module.device.resource) }}
- name: device
  hostPath: {path: {{ $module.device.path }}, type: CharDevice}
{{- end }}
{{- end -}}

{{/* Sidecars start before the module and end after it. Takes a list: root, module's name, module. */}}
{{- define "robot.sidecars" -}}
{{- $root := index . 0 -}}
{{- $name := index . 1 -}}
{{- $module := index . 2 -}}
{{- $simulated := and $module.device $module.device.simulated -}}
{{- if or $simulated $module.guard }}
initContainers:
{{- end }}
{{- if $simulated }}
- name: simulator
  {{- include "robot.image" (list $root $name) | nindent 2 }}
  restartPolicy: Always
  command: [/opt/module/bin/python, -m, modules.{{ $name }}.simulator, --listen, "4000"]
  resources:
    requests: {cpu: 100m, memory: 64Mi}
    limits: {cpu: 100m, memory: 64Mi}
  securityContext:
    {{- include "robot.rights" (list $module false) | nindent 4 }}
{{- end }}
{{- if $module.guard }}
- name: guard
  {{- include "robot.image" (list $root $name) | nindent 2 }}
  restartPolicy: Always
  command: [/opt/module/bin/python, -m, modules.{{ $name }}.guard]
  env:
  - name: ROBOT_PORT
    value: {{ include "robot.hardware" $module.device }}
  resources:
    requests: {cpu: 50m, memory: 64Mi}
    # 15m would do; more makes it start sooner.
    limits:
      cpu: 200m
      memory: 64Mi
      {{- with include "robot.resource" (list $module true) }}
      {{- . | nindent 6 }}
      {{- end }}
  securityContext:
    {{- include "robot.rights" (list $module true) | nindent 4 }}
  {{- if and (include "robot.touches" (list $module true)) (not $module.device.resource) }}
  volumeMounts:
  - {name: device, mountPath: {{ $module.device.path }}}
  {{- end }}
{{- end }}
{{- end -}}
