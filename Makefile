# One verb, one line. `make help` explains them all.
SHELL := /bin/bash
PYTHON := .venv/bin/python
CLUSTER := $(PYTHON) -m tests.node
POLICY ?= config/policies/delivery-robot.yaml
HEAVY := chromium skopeo
VOICES := flite festival festvox-kallpc16k festvox-us-slt-hts espeak-ng sox
MODULES := $(patsubst modules/%/Dockerfile,%,$(wildcard modules/*/Dockerfile))
# Excluded from coverage, which makes a test take 2.5 times as long: outside the operator, or all of it at random.
UNTRACED := tests/bench tests/fuzz tests/modules tests/oracle tests/timelines
STORIES := $(basename $(notdir $(wildcard timelines/experiments/stories/*.yaml)))
PAPER := exp1 exp2 exp3
chosen = $(filter $(or $(EXP),%),$(1))
TIMELINE ?= timelines/demo.json
CORES ?= 2
BOARD ?= raspberry-pi-4
DURATION ?= 3600

.DEFAULT_GOAL := help
.PHONY: unit-traced unit-untraced $(shell sed -n 's/^\([a-z0-9-]*\):.*## .*/\1/p' $(MAKEFILE_LIST))

help:  ## show this help
	@awk -F ':.*## ' '/^[a-z0-9-]+:.*## / {printf "  %-17s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: .venv/ready  ## install the Python packages into .venv

.venv/ready: pyproject.toml modules/robotkit/pyproject.toml modules/signs/models.txt
	python3 -m venv .venv
	$(PYTHON) -m pip install --quiet --disable-pip-version-check --editable '.[dev,modules]' --editable 'modules/robotkit[ros,serial]'
	$(PYTHON) -m pip install --quiet --disable-pip-version-check --no-deps --requirement modules/signs/models.txt
	touch $@

.venv/docs: pyproject.toml
	python3 -m venv .venv
	$(PYTHON) -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	touch $@

demo: images recordings  ## show the whole robot on a real node: a minute of sensor input moves CPU between its tasks
	$(PYTHON) -m timelines.datasets exp2 speech/exp2 signs/exp2
	$(CLUSTER) exec -- $(PYTHON) -m timelines.demo

test: lint unit e2e  ## run everything: lint, unit tests, end-to-end tests on a real node

test-all: test audit heavy soak  ## run everything, and the slow checks too: known vulnerabilities, promtool, a browser, hours of soak

lint: setup  ## check style and types
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy

audit: setup  ## check what the operator's image installs for known vulnerabilities; skipped without internet access
	$(PYTHON) -m pip install --quiet --disable-pip-version-check 'pip-audit>=2.10,<3'
	$(PYTHON) -m tests.audit || [ $$? = 2 ]

unit: setup recordings cluster  ## run the tests that need no cluster (helm comes with the node), in two parallel halves; lists the operator's least covered files
	$(MAKE) --no-print-directory --jobs 2 --output-sync=line unit-traced unit-untraced
	set -o pipefail; $(PYTHON) -m coverage report | awk 'NR == 1 || /^TOTAL/ || /%$$/ && $$NF + 0 < 85'

unit-traced:
	$(CLUSTER) exec -- $(PYTHON) -m coverage run -m pytest -q --ignore tests/e2e --ignore tests/heavy $(UNTRACED:%=--ignore %)

unit-untraced:
	$(PYTHON) -m pytest -q $(UNTRACED)

heavy: images  ## run the tests with promtool, chromium, a VerticalPodAutoscaler, GitOps libraries, Flux, a HelmChart, and a reproduced release
	dpkg --status $(HEAVY) >/dev/null 2>&1 || { apt-get update -qq && apt-get install -qq --no-install-recommends $(HEAVY); }
	$(CLUSTER) program promtool vpa metrics-server flux registry helm-controller
	$(PYTHON) -m charts.release
	$(PYTHON) -m charts.release --architecture $$(dpkg --print-architecture) --no-bill --output build/release-again
	$(PYTHON) -m pytest -q tests/heavy --ignore tests/heavy/node --ignore tests/heavy/test_helm_controller.py
	$(CLUSTER) exec -- $(PYTHON) -m pytest -q tests/heavy/node tests/heavy/test_helm_controller.py tests/heavy/test_autoscaler.py

e2e: images  ## run the tests that need a real node
	$(CLUSTER) exec -- $(PYTHON) -m pytest -q tests/e2e --ignore tests/e2e/test_reboot.py
	$(PYTHON) -m pytest -q tests/e2e/test_reboot.py

e2e-vm: setup  ## run tests in a virtual machine with systemd and cgroup v2, as on current robots, and reboot it (needs root)
	$(PYTHON) -m tests.vm

arm64: setup  ## build the operator's image for arm64, start it under emulation, and compare its plans with this machine's
	$(PYTHON) -m tests.arm64

soak: images  ## kill the router 20 times, then inject random contexts, pods, crashes and faults for DURATION seconds (3600); SEED repeats a run
	KILLS=20 $(CLUSTER) exec -- $(PYTHON) -m pytest -q tests/e2e/test_faults.py -k router_killed
	SOAK_SECONDS=$(DURATION) SOAK_SEED=$(SEED) $(CLUSTER) exec -- $(PYTHON) -m pytest -q -s \
	  -o faulthandler_timeout=$$(($(DURATION) + 1200)) tests/e2e/test_soak.py

simulate: setup  ## simulate what POLICY decides on TIMELINE, without root or a cluster
	$(PYTHON) -m contextpolicy simulate $(POLICY) $(TIMELINE) --cores $(CORES)

experiments: images recordings  ## compare ways to divide the CPU on a real, quiet node (EXP=exp3 REPEATS=1 for a quick look); resumes where it stopped
	mkdir -p build/experiments/timelines
	$(if $(call chosen,$(STORIES)),$(PYTHON) -m timelines.scenarios $(patsubst %,timelines/experiments/stories/%.yaml,$(call chosen,$(STORIES))) --record --out build/experiments/timelines)
	$(if $(call chosen,$(PAPER)),$(PYTHON) -m timelines.datasets $(foreach name,$(call chosen,$(PAPER)),$(name) speech/$(name) signs/$(name)))
	$(CLUSTER) exec -- $(PYTHON) -m timelines.experiments $(EXP) $(if $(REPEATS),--blocks $(REPEATS)) $(if $(MINUTES),--minutes $(MINUTES)) $(if $(COMMIT),--commit)

bench: setup  ## measure the decision engine: samples per second, sample to plan, memory
	$(PYTHON) -m tests.bench.engine

bench-live: setup  ## measure what a sample costs the running operator, compared with the bare callback and hand-over
	$(PYTHON) -m tests.bench.live

bench-calls: setup  ## count the Python calls of a change of context, from Zenoh's callback to the resizes
	$(PYTHON) -m tests.bench.calls

bench-hops: setup  ## measure where the time goes between a sample and the agent's write, compared with the minimum (needs root)
	$(PYTHON) -m tests.bench.hops

bench-footprint: images  ## measure the CPU and memory of operator, router and agent on a real node, compared with the minimum
	$(CLUSTER) exec -- $(PYTHON) -m tests.bench.footprint

bench-boot: images  ## measure the time from switching a robot on to its first plan
	$(PYTHON) -m tests.bench.boot

bench-container: images  ## measure what a container costs a module, compared with a bare process
	$(CLUSTER) exec -- $(PYTHON) -m tests.bench.container

bench-reaction: images  ## measure sample to cgroup on a real node against the alternatives (RESUME=--resume continues)
	$(CLUSTER) exec -- $(PYTHON) -m tests.bench.reaction $(RESUME)

bench-enforcement: setup  ## measure contexts against static weights, pinning and realtime, without Kubernetes (root; QUICK=--quick, RESUME=--resume)
	$(PYTHON) -m tests.bench.enforcement $(QUICK) $(RESUME)

bench-board: images  ## run the reaction benchmark on processors as slow as those of BOARD (raspberry-pi-4, raspberry-pi-5)
	dpkg --status p7zip >/dev/null 2>&1 || { apt-get update -qq && apt-get install -qq --no-install-recommends p7zip; }
	$(CLUSTER) exec -- $(PYTHON) -m tests.bench.slow_board $(BOARD) -- $(PYTHON) -m tests.bench.reaction --only table --rounds 5 --patience 0

bench-fleet: cluster  ## measure what 5000 pods and 50 policies cost the operator, on a real API server
	$(PYTHON) -m tests.bench.fleet

bench-growth: cluster  ## measure 1 to 100 policies, 1 to 300 containers and 1 to 1000 samples/s (RESUME=--resume continues)
	$(PYTHON) -m tests.bench.growth $(RESUME)

bench-devices: setup  ## measure what navigation, lidar and arm cost, and how accurate they are
	$(PYTHON) -m tests.bench.device_modules

bench-prediction: setup  ## measure how well `simulate --profiles` predicts what the kernel does (needs root)
	$(PYTHON) -m tests.bench.prediction

bench-wheels: setup  ## measure how fast a robot's wheels stop, including at a CPU limit of 10m (needs root)
	$(PYTHON) -m tests.bench.wheel_stop

cluster: setup  ## start a one-node Kubernetes (does nothing when KUBECONFIG is set)
	$(CLUSTER) up

cluster-down:  ## stop the one-node Kubernetes and leave nothing behind
	$(CLUSTER) down

images: cluster  ## build the images and import them into the node
	$(CLUSTER) image contextpolicy operator/Dockerfile .
	for module in $(MODULES); do $(CLUSTER) image contextpolicy-$$module modules/$$module/Dockerfile . || exit 1; done

recordings: setup  ## make the demo's recordings: a rendered EuRoC sequence and synthesised speech
	dpkg --status $(VOICES) >/dev/null 2>&1 || { apt-get update -qq && apt-get install -qq --no-install-recommends $(VOICES); }
	$(PYTHON) -m timelines.datasets

pictures: setup  ## draw what each sample policy does on its timeline, for the cookbook
	@for file in config/expectations/*.yaml; do \
	  command=$$(sed -n 's/^# contextpolicy \(simulate .*\) --assert.*/\1/p' $$file); \
	  $(PYTHON) -m contextpolicy $$command --plot config/policies/pictures/$$(basename $$file .yaml).svg >/dev/null || exit 1; \
	done

lock: setup  ## pin the versions and hashes of the packages in the operator's image
	.venv/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-header \
	  --no-annotate --upgrade pyproject.toml --output-file operator/requirements.txt

release: e2e-vm  ## build a release of the last commit into build/release (after e2e-vm, 40 minutes; BASE_IMAGE and KEY as in charts/release/README.md)
	$(PYTHON) -m charts.release $(if $(BASE_IMAGE),--base-image $(BASE_IMAGE)) $(if $(KEY),--key $(KEY))

version: setup  ## set VERSION everywhere, and turn the changelog's Unreleased section into its own
	$(PYTHON) -m charts.release.version $(VERSION)

# Needs only the extra `docs`: where `make setup` has not run, nothing else is installed.
docs: $(if $(wildcard .venv/ready),setup,.venv/docs)  ## write the generated reference pages, and build the site into build/site
	$(PYTHON) -m docs.generator
	NO_MKDOCS_2_WARNING=1 $(PYTHON) -m mkdocs build --config-file .mkdocs.yml --strict --quiet
	@echo 'Open build/site/index.html. To search it too: python3 -m http.server --directory build/site'

crds: setup  ## write the CEL functions into the canonical CRD, and copy it into the chart and into the package
	$(PYTHON) -m crds

format: setup  ## format the code
	.venv/bin/ruff format .
	.venv/bin/ruff check --fix .

clean:  ## remove what was built here (cached binaries stay)
	rm -rf build .venv .mypy_cache .pytest_cache .ruff_cache
