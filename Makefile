# Physically based fog for a single photograph.
#
#   make scene=bathroom                      the whole chain; results in build/bathroom/
#   make scene=bathroom fog=thick            another of the scene's fogs; results in build/bathroom/thick/
#   make scene=bathroom fog.visibility=3     any value of the scene file overridden
#   make test                                the tests
#   make help                                all targets and variables
#
# Stages meet in files: a rule below names what a stage reads and writes, and redoes it when one of them, its
# own source or a template is newer. Scene, fog and overrides reach Python through the environment, never
# through a shell.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:
.SUFFIXES:
MAKEFLAGS += --no-builtin-rules

.DEFAULT_GOAL := $(if $(scene),all,help)

scene ?=
fog ?=
PYTHON ?= python3
SCENES ?= scenes
BUILD ?= build

# ---- scene, fog and overrides ------------------------------------------------------------------
define newline


endef
empty :=
space := $(empty) $(empty)
ifneq ($(words x$(scene)),1)
  $(error scene name '$(scene)' has a space in it; name a folder under scenes/)
endif
ifneq ($(words x$(fog)),1)
  $(error fog name '$(fog)' has a space in it; name one of the scene's fogs)
endif
# every variable on the command line whose name has a dot overrides that value of the scene
dotted := $(foreach v,$(.VARIABLES),$(if $(and $(findstring .,$(v)),$(filter command,$(firstword $(origin $(v))))),$(v)))
export FOG_OVERRIDES := $(foreach v,$(dotted),$(v)=$(value $(v))$(newline))
export FOG_SCENE := $(value scene)
export FOG_NAME := $(value fog)
export FOG_SCENES := $(SCENES)
export FOG_BUILD := $(BUILD)

# ---- set-up ------------------------------------------------------------------------------------
VENV := .venv
PY := $(VENV)/bin/python
READY := $(VENV)/ready

$(READY): pipeline/requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "error: $(PYTHON) is older than 3.11; install Python 3.11 or newer, or name it: make PYTHON=python3.12" >&2; exit 2; }
	@echo "set-up: Python packages into $(VENV)"
	@rm -rf $(VENV).partial; $(PYTHON) -m venv --clear $(VENV) || \
	  { echo "error: no virtual environment; install Python's venv module (on Debian: apt-get install python3-venv)" >&2; exit 2; }
	@$(PY) -m pip install --quiet --disable-pip-version-check --require-hashes --only-binary :all: -r $< || \
	  { echo "error: the packages of $< could not be installed; is there a network?" >&2; exit 2; }
	@touch $@

.PHONY: povray setup
povray:
	@command -v "$${POVRAY:-povray}" >/dev/null && exit 0; \
	if command -v apt-get >/dev/null && [ "$$(id -u)" = 0 ]; then as=""; \
	elif command -v apt-get >/dev/null && command -v sudo >/dev/null && sudo -n true 2>/dev/null; then as="sudo -n"; \
	else echo "error: POV-Ray is not installed; run: sudo apt-get install povray (or your system's equivalent)" >&2; exit 2; fi; \
	echo "set-up: POV-Ray from the system's packages"; \
	{ $$as apt-get update -qq || true; $$as env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends povray; } >/dev/null || \
	{ echo "error: POV-Ray could not be installed; run: sudo apt-get install povray" >&2; exit 2; }

setup: $(READY) povray

# ---- the chain ---------------------------------------------------------------------------------
S := $(BUILD)/$(scene)
O := $(S)$(if $(fog),/$(fog))
run = @$(PY) -m pipeline
plugins := $(shell find pipeline/plugins pipeline/physics pipeline/geometry -name '*.py' 2>/dev/null)
templates := $(shell find templates povray_includes $(if $(scene),$(wildcard $(SCENES)/$(scene)/templates)) -type f ! -name '*.html' 2>/dev/null) \
             $(if $(scene),$(wildcard $(SCENES)/$(scene)/*.inc $(SCENES)/$(scene)/*.pov $(SCENES)/$(scene)/*/*.inc))
source = pipeline/stages/$(1).py $(plugins)

.PHONY: all resolve closure FORCE
all: $(O)/report.html
	@echo "done: $(O)/foggy.png, $(O)/report.html"

# Always looked at, but a part of the scene that did not change keeps its time stamp.
SHARED_INPUTS := $(addprefix $(S)/inputs/,photograph.json camera.json shapes.json lights.json strengths.json illumination.json sun_direction.json)
FOG_INPUTS := $(addprefix $(O)/inputs/,fog.json render.json gains.json)
resolve: $(READY) | povray
	$(run) resolve
$(SHARED_INPUTS) $(FOG_INPUTS): resolve ;

$(S)/photograph.json $(S)/photograph.exr $(S)/clipped.exr &: $(S)/inputs/photograph.json pipeline/imaging/photograph.py $(call source,photograph)
	$(run) photograph
$(S)/camera.json: $(S)/inputs/camera.json $(S)/photograph.json $(call source,camera)
	$(run) camera
$(S)/geometry.json $(S)/depth.exr $(S)/surfaces.exr &: $(S)/camera.json $(S)/inputs/shapes.json $(S)/inputs/lights.json $(call source,geometry)
	$(run) geometry
$(S)/sun_direction.json: $(S)/geometry.json $(S)/inputs/sun_direction.json pipeline/estimation/sun_direction.py $(call source,sun_direction)
	$(run) sun_direction
$(S)/illumination.json $(S)/albedo.exr &: $(S)/geometry.json $(S)/sun_direction.json $(S)/photograph.json $(S)/inputs/illumination.json $(S)/inputs/strengths.json \
  $(templates) $(wildcard pipeline/estimation/*.py pipeline/rendering/*.py) $(call source,illumination)
	$(run) illumination
$(O)/plan.json: $(S)/illumination.json $(O)/inputs/fog.json $(O)/inputs/render.json pipeline/rendering/runs.py $(call source,plan)
	$(run) plan
$(O)/pov/emitted.json: $(O)/plan.json $(templates) pipeline/rendering/emit.py $(call source,emit)
	$(run) emit
$(O)/runs/done.json: $(O)/pov/emitted.json pipeline/rendering/povray.py $(call source,render)
	$(run) render
$(O)/maps.json: $(O)/runs/done.json $(O)/inputs/gains.json $(call source,decompose)
	$(run) decompose
$(O)/foggy.png: $(O)/maps.json $(S)/photograph.json $(call source,composite)
	$(run) composite
$(O)/report.html: $(O)/foggy.png pipeline/imaging/overlay.py templates/report.html \
  $(wildcard $(SCENES)/$(scene)/report.html $(SCENES)/$(scene)/templates/report.html) $(call source,report)
	$(run) report

closure: $(O)/report.html
	$(run) closure

# ---- other things a person asks for ------------------------------------------------------------
.PHONY: test test-slow photos photograph schema plugins clean help
test: setup
	@OMP_NUM_THREADS=1 $(PY) -m pytest -n 2 -m "not slow"

test-slow: setup
	@OMP_NUM_THREADS=1 $(PY) -m pytest -n 2

photos: $(READY)
	$(run) photos

photograph: setup
	@$(PY) "$(SCENES)/$${FOG_SCENE:?name the scene: make photograph scene=bathroom}/model/render.py"

schema: $(READY)
	$(run) schema

plugins: $(READY)
	$(run) plugins

clean:
	@[ -n "$${FOG_SCENE}" ] && rm -rf -- "$(BUILD)/$${FOG_SCENE##*/}" || rm -rf -- "$(BUILD)"

help:
	@echo "targets"
	@echo "  make scene=NAME          fog in scenes/NAME, into build/NAME/ (report.html shows all of it)"
	@echo "  make closure scene=NAME  checks photograph * T + V against fog and surfaces rendered in one pass"
	@echo "  make photos              fetches the real demo photographs (sunroom, lobby)"
	@echo "  make photograph scene=bathroom   renders the synthetic photograph again from its model"
	@echo "  make plugins             lists lights, shapes, media, ... with parameters and units"
	@echo "  make schema              writes scenes/scene.schema.json, for completion in editors"
	@echo "  make test, test-slow     the tests; with the slow ones"
	@echo "  make setup               only installs what is needed"
	@echo "  make clean [scene=NAME]  removes build/ or build/NAME/"
	@echo "variables"
	@echo "  scene=NAME               folder under scenes/"
	@echo "  fog=NAME                 one of the scene's named fogs, into build/NAME/FOG/"
	@echo "  PATH.TO.VALUE=X          overrides any value: fog.visibility=3 lights.sun.gain=0.5 render.samples=48"
	@echo "  SCENES=DIR BUILD=DIR     where scenes and results are (scenes, build)"
	@echo "  PYTHON=python3.12        the Python to set up with; POVRAY=PROGRAM the POV-Ray to use"
