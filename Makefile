# Physically based fog for a single photograph.
#
#   make scene=bathroom                      the whole chain; results in build/bathroom/
#   make scene=bathroom fog=thick            another of the scene's fogs; results in build/bathroom/thick/
#   make scene=bathroom fog.visibility=3     any value of the scene file overridden
#   make ladder scene=pagoda                 its named fogs side by side, in build/pagoda/ladder.png
#   make match scene=building reference=foggy.jpg   its fog as in that photograph of the same view
#   make annotate scene=mine photo=IMG.jpg   a page that annotates a photograph and shows its fog
#   make test                                the tests
#   make help                                all targets and variables
#
# Stages meet in files: a rule below names what a stage reads and writes, and redoes it when one of them, its
# own source or a template is newer. Where a stage writes several files, Make looks at the one written last, so
# that an interrupted stage is redone, and at whether the others are there. Scene, fog and overrides reach
# Python through the environment, never through a shell.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:
.SUFFIXES:
# `make -n` tells what sources and templates would redo; what the scene file would, only a real run finds out
dry_run := $(findstring n,$(filter-out --%,$(firstword -$(MAKEFLAGS))))
MAKEFLAGS += --no-builtin-rules

ifneq ($(words $(CURDIR)),1)
  $(error the project lies in '$(CURDIR)', whose name has a space: POV-Ray and Make cannot use it; move or rename the folder)
endif

scene ?=
fog ?=
fogs ?=
cases ?= 2000
seed ?= 1
repeats ?= 5
to ?=
reference ?=
reference_scene ?=
fit ?=
file ?=
replace ?=
quality ?=
tolerance ?=
budget ?=
study ?=
answers ?=
simulate ?=
photo ?=
port ?= 0
PYTHON ?= python3
SCENES ?= scenes
BUILD ?= build

# ---- scene, fog and overrides ------------------------------------------------------------------
# Names become targets and prerequisites, in which Make would expand $(...): nothing but $(value) touches them
# before they are known to be plain.
unexport scene fog fogs cases seed repeats to reference reference_scene fit file replace quality tolerance budget study answers simulate photo port
define newline


endef
digits := 0 1 2 3 4 5 6 7 8 9
letters := a b c d e f g h i j k l m n o p q r s t u v w x y z \
           A B C D E F G H I J K L M N O P Q R S T U V W X Y Z
plain := $(digits) $(letters) _ - .
define strip_plain
  rest := $$(value $(1))
  $$(foreach c,$(plain) $(2),$$(eval rest := $$$$(subst $$(c),,$$$$(rest))))
endef
define check_name
  $(call strip_plain,$(1))
  ifneq ($$(rest)$$(findstring ..,$$(value $(1)))$$(filter-out $(addsuffix %,$(digits) $(letters)),$$(value $(1))),)
    $$(error $(1) name '$$(value $(1))': use letters, digits, '_', '-' and '.', beginning with a letter or digit)
  endif
endef
define check_folder
  $(call strip_plain,$(1),/ + @)
  ifneq ($$(rest)$$(if $$(value $(1)),,x),)
    $$(error $(1)='$$(value $(1))': Make can only use a folder's path of letters, digits and '/_-.+@')
  endif
endef
define check_names
  $(call strip_plain,$(1))
  ifneq ($$(strip $$(rest))$$(findstring ..,$$(value $(1)))$$(filter-out $(addsuffix %,$(digits) $(letters)),$$(value $(1))),)
    $$(error $(1)='$$(value $(1))': name the fogs with spaces between them, such as $(1)="light thick")
  endif
endef
$(eval $(call check_name,scene))
$(eval $(call check_name,fog))
$(eval $(call check_name,to))
$(eval $(call check_name,reference_scene))
$(eval $(call check_name,quality))
$(eval $(call check_name,tolerance))
$(eval $(call check_name,budget))
$(eval $(call check_names,fogs))
define check_number
  $(call strip_plain,$(1))
  ifneq ($$(rest)$$(filter-out $(addsuffix %,$(digits)),$$(value $(1)))$$(findstring -,$$(value $(1))),)
    $$(error $(1)='$$(value $(1))': give a whole number)
  endif
endef
$(eval $(call check_number,cases))
$(eval $(call check_number,seed))
$(eval $(call check_number,repeats))
$(eval $(call check_number,simulate))
$(eval $(call check_number,port))
$(if $(value study),$(eval $(call check_folder,study)))
$(if $(value answers),$(eval $(call check_folder,answers)))
$(eval $(call check_folder,SCENES))
$(eval $(call check_folder,BUILD))

# every variable on the command line whose name has a dot overrides that value of the scene; groups come first
stated := $(sort $(foreach v,$(.VARIABLES),$(if $(filter command,$(firstword $(origin $v))),$v)))
dotted := $(strip $(foreach v,$(stated),$(if $(findstring .,$v),$v)))
known := scene fog fogs cases seed repeats to reference reference_scene fit file replace quality tolerance budget study answers simulate photo port SCENES BUILD PYTHON POVRAY SHELL MAKEFLAGS
strange := $(firstword $(filter-out $(known) $(dotted),$(stated)))
ifneq ($(strange),)
  $(error no variable is called '$(strange)': use scene, fog, fogs, a value of the scene by its path such as fog.visibility=3, or see `make help`)
endif
# one of quality, tolerance and budget is what is asked; said here, it outweighs all three of the scene file
asked := $(strip $(foreach v,quality tolerance budget,$(if $(value $v),$v)))
$(if $(word 2,$(asked)),$(error $(firstword $(asked))= and $(word 2,$(asked))= both say how accurate it is to be: give one))
asked_value := $(if $(filter budget,$(asked)),$(patsubst %s,%,$(value budget)),$(if $(asked),$(value $(asked))))
asking := $(if $(asked),$(foreach v,$(filter-out $(asked),tolerance budget),render.$v=null$(newline))render.$(asked)=$(asked_value)$(newline))
export FOG_OVERRIDES := $(asking)$(foreach v,$(dotted),$v=$(value $v)$(newline))
export FOG_SCENE := $(value scene)
export FOG_NAME := $(value fog)
export FOG_LADDER := $(value fogs)
export FOG_TO := $(value to)
export FOG_STUDY := $(value study)
export FOG_ANSWERS := $(value answers)
export FOG_SIMULATE := $(value simulate)
export FOG_REFERENCE := $(value reference)
export FOG_REFERENCE_SCENE := $(value reference_scene)
export FOG_FIT := $(value fit)
export FOG_PHOTO := $(value photo)
export FOG_PORT := $(value port)
export FOG_FILE := $(value file)
export FOG_REPLACE := $(value replace)
export FOG_SCENES := $(SCENES)
export FOG_BUILD := $(BUILD)

.DEFAULT_GOAL := $(if $(scene),all,help)
goals := $(or $(MAKECMDGOALS),$(.DEFAULT_GOAL))
ifeq ($(scene),)
  ifneq ($(filter all resolve closure export crosscheck compare ladder tradeoff match import-annotations export-annotations photograph truth study-truth annotate,$(goals))$(fog)$(fogs)$(if $(filter study study-results,$(goals)),,$(dotted)),)
    $(error no scene is named: $(strip make $(MAKECMDGOALS) scene=bathroom))
  endif
endif
ifeq ($(MAKELEVEL),0)
  ifeq ($(filter ladder study-truth,$(goals)),)
    $(if $(fogs),$(error fogs= is for the ladder: make ladder scene=$(scene) fogs="$(fogs)"))
  else
    $(if $(fog),$(error $(if $(filter ladder,$(goals)),a ladder shows,study-truth renders) several fogs: leave out fog=$(fog), or say fogs="$(fog) ..."))
  endif
  ifneq ($(filter study study-results,$(goals)),)
    $(if $(scene)$(dotted),$(error a study's description says which scenes and fogs it shows: leave out $(if $(scene),scene=$(scene),$(firstword $(dotted))=...), or name another one: study=FILE))
  else
    $(if $(study)$(answers)$(simulate),$(error study=, answers= and simulate= are for make study and make study-results))
  endif
  ifeq ($(filter match,$(goals)),)
    $(foreach v,reference reference_scene fit,$(if $(value $v),$(error $v= is for a match: make match scene=$(scene) reference=foggy.jpg)))
  else
    $(if $(value reference),,$(error no photograph in fog is named: make match scene=$(scene) reference=foggy.jpg))
  endif
  ifeq ($(filter annotate,$(goals)),)
    $(if $(value photo)$(filter-out 0,$(value port)),$(error photo= and port= are for the page: make annotate scene=$(or $(scene),mine) photo=IMG.jpg))
  else
    $(if $(fog)$(dotted),$(error the page changes the scene file itself: leave out $(if $(fog),fog=$(fog),$(firstword $(dotted))=...)))
  endif
  ifeq ($(filter import-annotations export-annotations,$(goals)),)
    $(foreach v,file replace,$(if $(value $v),$(error $v= is for annotations: make import-annotations scene=$(scene) file=annotations.json)))
  else
    $(if $(value file),,$(error no file is named: make $(goals) scene=$(scene) file=annotations.json))
  endif
endif

# ---- set-up ------------------------------------------------------------------------------------
VENV := .venv
PY := $(VENV)/bin/python
READY := $(VENV)/ready
pip_install := -m pip install --quiet --disable-pip-version-check --require-hashes --only-binary :all:

# $(call extra,packages,target,lock): complete locks, so that nothing that they do not name takes the place of ours
comma := ,
define extra
echo "set-up: $(1) into $(VENV)"; \
$(PY) $(pip_install) --no-deps -r pipeline/requirements-$(3).lock || \
{ echo "error: $(1) could not be installed; see above, and run make $(2) again" >&2; exit 2; }
endef

# $(call system_package,name,variable that names the program,program,packages)
define system_package
command -v "$${$(2):-$(3)}" >/dev/null && exit 0; \
if [ -n "$${$(2):-}" ]; then echo "error: no program '$$$(2)'; correct $(2), or leave it out" >&2; exit 2; fi; \
if command -v apt-get >/dev/null && [ "$$(id -u)" = 0 ]; then as=""; \
elif command -v apt-get >/dev/null && command -v sudo >/dev/null && sudo -n true 2>/dev/null; then as="sudo -n"; \
else echo "error: $(1) is not installed; run: sudo apt-get install $(3) (or your system's equivalent)" >&2; exit 2; fi; \
echo "set-up: $(1) from the system's packages"; \
{ $$as apt-get update -qq || true; \
  $$as env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $(4); } >/dev/null </dev/null || \
{ echo "error: $(1) could not be installed; run: sudo apt-get install $(3)" >&2; exit 2; }
endef

$(READY): pipeline/requirements.lock
	@refuse() { echo "error: $$1" >&2; exit 2; }; \
	command -v $(firstword $(PYTHON)) >/dev/null || refuse "no program '$(PYTHON)'; install Python 3.11 or newer, or name it: make PYTHON=python3.12"; \
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  refuse "$(PYTHON) is older than 3.11; install Python 3.11 or newer, or name it: make PYTHON=python3.12"; \
	$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || \
	  refuse "$(PYTHON) makes no virtual environments; install its venv module (on Debian: sudo apt-get install python3-venv)"; \
	[ ! -L $(VENV) ] || refuse "$(VENV) is a link; remove it: what it points to would be emptied"; \
	echo "set-up: Python packages into $(VENV)"; \
	$(PYTHON) -m venv --clear $(VENV) || refuse "no virtual environment in $(VENV); see above"; \
	$(PY) $(pip_install) -r $< || refuse "the packages of $< could not be installed; see above, and run make again"
	@touch $@

.PHONY: povray setup setup-mitsuba setup-figures setup-browser setup-compare setup-annotate
povray:
	@$(call system_package,POV-Ray,POVRAY,povray,povray)

setup: $(READY) povray

# only what compares with Mitsuba needs it, and nothing else asks for it
setup-mitsuba: $(READY)
	@$(call extra,Mitsuba 3,$@,mitsuba)

# only pictures of curves need it
FIGURES_READY := $(VENV)/figures-ready
setup-figures: $(FIGURES_READY)
$(FIGURES_READY): pipeline/requirements-figures.lock $(READY)
	@$(call extra,matplotlib,setup-figures,figures)
	@touch $@

# only the page that annotates needs a server
ANNOTATE_READY := $(VENV)/annotate-ready
setup-annotate: $(ANNOTATE_READY)
$(ANNOTATE_READY): pipeline/requirements-annotate.lock $(READY)
	@$(call extra,Bokeh,setup-annotate,annotate)
	@touch $@

# only what uses a page as people do needs a browser
setup-browser: $(READY)
	@$(call extra,Playwright,$@,browser)
	@$(call system_package,Chromium,CHROMIUM,chromium,chromium fonts-dejavu-core)

# only `make compare` runs these tools; without their own OpenCV, which would take the place of ours
setup-compare: $(READY)
	@$(call extra,albumentations$(comma) imagecorruptions and euler-preprocess,$@,compare)

# ---- the chain ---------------------------------------------------------------------------------
S := $(BUILD)/$(scene)
O := $(S)$(if $(fog),/$(fog))
view = $(or $(reference_scene),$(scene))
# images of a photograph larger than its working size have that size in this folder
W := $(shell [[ -f $(S)/photograph.json && "$$(< $(S)/photograph.json)" == *working_width_pixel* ]] && echo working/)
# whose make it is that works in the folder: one that was started by a make works for that one
owner = FOG_MAKE=$${FOG_MAKE:-$$PPID}
run = @$(owner) $(PY) -m pipeline
# a fog's stages follow one another in one process, up to what is asked for; it notes for this make which it has done
asked_for_files := %/plan.json %/emitted.json %/done.json %/maps.json
ahead := $(if $(filter-out $(asked_for_files) %/foggy.png,$(goals)),report,$(if $(filter %/foggy.png,$(goals)),composite))
this_make := $(shell echo "$$PPID.$${EPOCHREALTIME:-}.$$RANDOM$$RANDOM")
chain = @grep -qsxF "$(this_make) $(1)" $(O)/.ahead || $(owner) FOG_AHEAD=$(ahead) FOG_RUN=$(this_make) $(PY) -m pipeline $(1)

# what a stage is made from: its own source, and the packages that do its work
code = pipeline/stages/$(1).py $(wildcard $(foreach d,$(2),pipeline/$(d)/*.py pipeline/$(d)/*/*.py))
geometry := geometry plugins
beside = $(if $(filter-out $(wildcard $(1)),$(1)),FORCE)
templates := $(shell find templates povray_includes -type f \( -name '*.inc' -o -name '*.pov' \) 2>/dev/null)
closure_templates := templates/closure.pov
clear_templates := templates/irradiance.pov templates/bounce.pov
fog_templates := templates/in_scattering.pov templates/transmittance.pov povray_includes/fog_scattering.inc \
                 $(filter templates/media/% templates/phase_functions/%,$(templates))

# what a stage wrote is whole, and stays where one that follows it in the same process fails
.PRECIOUS: $(addprefix $(O)/,plan.json pov/emitted.json runs/done.json maps.json foggy.png)

.PHONY: all resolve closure export crosscheck compare ladder tradeoff match import-annotations export-annotations calibrate study study-results study-truth truth annotate FORCE
all: $(O)/report.html
	@echo "done: $(O)/foggy.png, $(O)/report.html"

# Always looked at, but a part of the scene that did not change keeps its time stamp.
SHARED_INPUTS := $(addprefix $(S)/inputs/,photograph.json camera.json depth.json shapes.json lights.json strengths.json \
                   illumination.json sun_direction.json exporter.json templates.json plugins.json demand.json)
FOG_INPUTS := $(addprefix $(O)/inputs/,fog.json fog_files.json render.json composite.json gains.json)
resolve: $(READY) | povray
	@$(owner) $(PY) -m pipeline resolve
ifeq ($(dry_run),)
$(SHARED_INPUTS) $(FOG_INPUTS): resolve ;
endif

$(S)/photograph.json: $(call beside,$(foreach f,photograph clipped,$(S)/$(f).exr $(S)/$(W)$(f).exr)) $(S)/inputs/photograph.json \
  $(wildcard pipeline/imaging/photograph*.py) pipeline/imaging/colour.py pipeline/imaging/display_window.py pipeline/imaging/map_strips.py $(call code,photograph)
	$(run) photograph
$(S)/camera.json: $(S)/inputs/camera.json $(S)/photograph.json pipeline/scene/described_camera.py $(call code,camera,geometry)
	$(run) camera
$(S)/geometry.json: $(call beside,$(foreach f,depth surfaces,$(S)/$(f).exr $(S)/$(W)$(f).exr)) $(S)/camera.json \
  $(addprefix $(S)/inputs/,shapes.json lights.json depth.json plugins.json) $(S)/photograph.json pipeline/scene/outdoors.py \
  pipeline/scene/full_size.py pipeline/scene/placed.py pipeline/imaging/map_strips.py \
  $(wildcard pipeline/imaging/edges.py pipeline/imaging/glare.py pipeline/imaging/display_window.py pipeline/imaging/depth_*.py) $(call code,geometry,$(geometry))
	$(run) geometry
$(S)/sun_direction.json: $(S)/geometry.json $(S)/inputs/sun_direction.json pipeline/scene/described_sun.py $(call code,sun_direction,$(geometry)) \
  $(wildcard pipeline/estimation/sun_*.py pipeline/estimation/spherical.py)
	$(run) sun_direction
# what the fog sees round it, where that is not the open plain, and what lights a room
around = $(shell [[ -f $(S)/illumination.json && "$$(< $(S)/illumination.json)" == *mean_radiance* ]] && echo $(addprefix $(S)/basis/surroundings,.exr _hits.exr)) \
  $(shell [[ -f $(S)/illumination.json && "$$(< $(S)/illumination.json)" == *spacing_m* ]] && echo $(addprefix $(S)/basis/room,.exr _hits.exr _places.exr))
$(S)/illumination.json: $(call beside,$(S)/$(W)albedo.exr $(around) $(patsubst %.pov,%.exr,$(wildcard $(S)/basis/irradiance_*.pov))) \
  $(S)/geometry.json $(S)/sun_direction.json $(S)/photograph.json \
  $(addprefix $(S)/inputs/,illumination.json strengths.json exporter.json templates.json demand.json) \
  $(filter-out $(fog_templates) $(closure_templates),$(templates)) pipeline/physics/fog_transport.py \
  $(call code,illumination,$(geometry) estimation rendering)
	$(run) illumination
$(O)/plan.json: $(S)/illumination.json $(O)/inputs/fog.json $(O)/inputs/fog_files.json $(O)/inputs/render.json \
  $(S)/inputs/templates.json templates/SHA256SUMS $(filter-out $(clear_templates) $(closure_templates),$(templates)) \
  $(wildcard $(addprefix pipeline/rendering/,runs.py fineness.py own_templates.py surroundings_files.py) pipeline/planning/*) $(call code,plan,$(geometry))
	$(call chain,plan)
$(O)/pov/emitted.json: $(O)/plan.json $(S)/inputs/templates.json \
  $(filter-out $(clear_templates) $(closure_templates),$(templates)) $(wildcard $(addprefix pipeline/rendering/,emit.py pruning.py)) $(call code,emit,$(geometry))
	$(call chain,emit)
$(O)/runs/done.json: $(call beside,$(patsubst $(O)/pov/%.pov,$(O)/runs/%.exr,$(wildcard $(O)/pov/*.pov))) \
  $(O)/pov/emitted.json pipeline/rendering/povray.py $(call code,render)
	$(call chain,render)
$(O)/maps.json: $(call beside,$(O)/$(W)transmittance.exr $(O)/$(W)in_scattering.exr) $(O)/runs/done.json $(O)/inputs/gains.json \
  $(wildcard $(addprefix pipeline/rendering/,scattered.py view.py converged.py enlarged.py enclosed.py surroundings_files.py) \
  $(addprefix pipeline/estimation/,fog_surroundings.py room_light.py) pipeline/planning/accuracy.py) \
  $(call code,decompose,$(geometry) physics)
	$(call chain,decompose)
$(O)/foggy.png: $(call beside,$(O)/foggy.exr $(O)/transmittance.exr $(O)/in_scattering.exr) $(O)/maps.json $(S)/photograph.json $(O)/inputs/composite.json \
  $(addprefix pipeline/,physics/composition.py physics/enlarging.py rendering/enlarged.py imaging/map_strips.py) \
  $(wildcard pipeline/imaging/photograph*.py) pipeline/imaging/colour.py $(call code,composite)
	$(call chain,composite)
$(O)/report.html: $(call beside,$(O)/manifest.json $(S)/overlay.png) $(O)/foggy.png $(S)/inputs/templates.json templates/report.html \
  $(wildcard pipeline/imaging/overlay*.py) pipeline/imaging/canvas.py $(wildcard pipeline/imaging/display.py) $(call code,report,reporting)
	$(call chain,report)

closure: $(O)/report.html
	$(run) closure

export: $(O)/report.html
	$(run) export

crosscheck: $(O)/report.html
	$(run) crosscheck

compare: $(O)/report.html
	$(run) compare

# by the project's own models and programs; of a scene's folder nothing is run
truth: resolve
	@OMP_NUM_THREADS=1 $(PY) -m tests.validation.ground_truth

# one fog after the other, each by a make of its own
ladder: $(READY) | povray
	$(run) resolve
	@export $(owner); names="$$($(PY) -m pipeline ladder --names)"; for name in $$names; do \
	  $(MAKE) --no-print-directory fog=$$name $(S)/$$name/foggy.png; done
	$(run) ladder

tradeoff: $(O)/report.html | $(FIGURES_READY)
	$(run) tradeoff

# the light of the view that the photograph in fog shows, by a make of its own, then trial fogs as they are wanted
match: $(READY) | povray
	@export $(owner); $(MAKE) --no-print-directory scene=$(view) $(BUILD)/$(view)/illumination.json
	$(run) match

# a person's own page: what it makes by the way is gone when it ends
annotate: setup $(ANNOTATE_READY)
	@$(PY) -m pipeline annotate

# a file from another annotation program into the scene file, and back; fSpy's needs the camera as worked out
import-annotations: $(READY)
	@$(PY) -m pipeline annotations --import

export-annotations: $(READY) $(if $(filter export-annotations,$(goals)),$(if $(filter fspy,$(to)),$(S)/camera.json))
	@$(PY) -m pipeline annotations --export

# what the plan knows of time and error, measured on this machine
calibrate: $(READY) | povray
	@export $(owner); $(PY) -m pipeline calibrate --cases | while read case; do \
	  $(MAKE) --no-print-directory $$case; done
	$(run) calibrate

# ---- the paper's figures -------------------------------------------------------------------------
# Each is redone when a scene that it shows, or what draws it, has changed; the scenes' own makes say whether they have.
FIGURES := $(BUILD)/figures
drawn := $(addprefix $(FIGURES)/,$(addsuffix .png,fig01 fig02 fig05 fig06 fig07 fig08 fig09 fig10 fig11 fig12 fig13 fig14 fig15 table1))
drawing = $(wildcard pipeline/figures/*.py pipeline/imaging/overlay*.py) pipeline/imaging/canvas.py pipeline/imaging/display.py
.PHONY: figures
figures: $(FIGURES)/figures.html

ifneq ($(filter figures $(FIGURES)/%,$(goals)),)
# of a scene that is not there nothing is made, and its figures say so
$(BUILD)/%/report.html: FORCE | setup
	@set -- $(subst /, ,$*); [ ! -d "$(SCENES)/$$1" ] || $(MAKE) -s --no-print-directory scene=$$1 fog=$${2:-}
# made on the way to a figure, and kept: the next run looks at them
.PRECIOUS: $(BUILD)/%/report.html $(BUILD)/%/compare/compare.csv
$(FIGURES)/fig01.png: $(addprefix $(BUILD)/,bathroom/report.html building/report.html)
$(FIGURES)/fig02.png $(FIGURES)/fig05.png $(FIGURES)/fig06.png: $(BUILD)/bathroom/report.html
$(FIGURES)/fig07.png: $(BUILD)/building/report.html
$(BUILD)/%/compare/compare.csv: $(BUILD)/%/report.html $(wildcard pipeline/plugins/baseline*.py pipeline/plugins/baselines/*.py) pipeline/stages/compare.py
	@[ ! -d "$(SCENES)/$*" ] || $(MAKE) -s --no-print-directory scene=$* compare
$(FIGURES)/fig11.png: $(BUILD)/bathroom/compare/compare.csv
$(FIGURES)/fig12.png: $(BUILD)/lamps/compare/compare.csv
$(FIGURES)/fig13.png: $(BUILD)/building/moderate/report.html
$(FIGURES)/fig14.png: $(addprefix $(BUILD)/building/,report.html moderate/report.html thick/report.html)
$(FIGURES)/fig13.png $(FIGURES)/fig14.png $(FIGURES)/fig15.png: $(wildcard $(SCENES)/study.yaml pipeline/study/*.py $(SCENES)/building/truth/*)
$(FIGURES)/fig15.png: $(wildcard $(BUILD)/study/results.png)
$(FIGURES)/fig08.png $(FIGURES)/fig09.png $(FIGURES)/fig10.png: $(BUILD)/validation/mse.csv
$(FIGURES)/table1.png: $(foreach s,bathroom building,$(wildcard $(addprefix $(SCENES)/$s/,scene.yaml photograph.*))) $(templates) \
  $(wildcard pipeline/*.py pipeline/stages/*.py pipeline/rendering/*.py pipeline/physics/*.py pipeline/planning/*.py)
$(BUILD)/validation/mse.csv: $(foreach s,cornell cornell_height,$(wildcard $(SCENES)/$s/scene.yaml)) $(templates) \
  $(wildcard tests/validation/*.py tests/reference/*.py pipeline/rendering/*.py pipeline/physics/*.py pipeline/plugins/lights/*.py) | setup
	@OMP_NUM_THREADS=1 $(PY) -m tests.validation --only approximations --variants default --folder $(BUILD)/validation
$(drawn): $(drawing) | $(FIGURES_READY)
	@$(PY) -m pipeline figures --only $(basename $(@F))
$(FIGURES)/figures.html: $(drawn) templates/figures.html
	@$(PY) -m pipeline figures --book
endif

# the fogs that it shows, each by a make of its own, and the page
study: $(READY) | povray
	@export $(owner); cases="$$($(PY) -m pipeline study --cases)"; while read -r case; do \
	  $(MAKE) --no-print-directory study= $$case; done <<< "$$cases"
	$(run) study

study-results: $(FIGURES_READY)
	@$(PY) -m pipeline study-results --seed $(seed)

# what a camera would have seen, rendered from the model of a scene that we made
study-truth: setup
	@[ -f $(SCENES)/$(scene)/model/foggy.py ] || \
	  { echo "error: $(SCENES)/$(scene) has no model/foggy.py; fog was not rendered into its model" >&2; exit 2; }
	@OMP_NUM_THREADS=1 $(PY) $(SCENES)/$(scene)/model/foggy.py $(fogs)

# ---- other things a person asks for ------------------------------------------------------------
.PHONY: test test-slow test-browser fuzz validation bench bench-record bench-lamps bench-full-size bench-tolerances bench-match bench-preview bench-annotate photos photograph schema plugins digests clean help
test: setup $(FIGURES_READY)
	@OMP_NUM_THREADS=1 $(PY) -m pytest -n 3 -m "not slow"

test-slow: setup
	@OMP_NUM_THREADS=1 $(PY) -m pytest -n 2

# the pages of the study and of annotating, in a real browser; the other tests leave them out where there is none
test-browser: setup setup-browser setup-annotate setup-figures
	@OMP_NUM_THREADS=1 $(PY) -m pytest -n 2 tests/test_study_browser.py tests/test_annotate_browser.py

fuzz: setup
	@OMP_NUM_THREADS=1 $(PY) -m tests.fuzzing --cases $(cases) --seed $(seed)

validation: setup
	@OMP_NUM_THREADS=1 $(PY) -m tests.validation

bench bench-record: setup
	@$(PY) -m tests.benchmarks --folder $(BUILD)/bench --repeats $(repeats) $(if $(filter bench-record,$@),--record)

bench-full-size: setup
	@$(PY) -m tests.benchmarks.full_size

bench-tolerances: setup
	@$(PY) -m tests.benchmarks.tolerances --build $(BUILD)

bench-match: setup
	@$(PY) -m tests.benchmarks.matches

bench-preview: setup
	@$(PY) -m tests.benchmarks.preview --repeats $(repeats)

bench-annotate: setup setup-browser setup-annotate
	@OMP_NUM_THREADS=1 $(PY) -m tests.benchmarks.annotate $(if $(scene),--scene $(scene))

bench-lamps: setup
	@$(PY) -m tests.benchmarks.many_lamps

photos: $(READY)
	$(run) photos

photograph: setup
	@[ -f $(SCENES)/$(scene)/model/render.py ] || \
	  { echo "error: $(SCENES)/$(scene) has no model/render.py; its photograph was not rendered" >&2; exit 2; }
	@$(PY) $(SCENES)/$(scene)/model/render.py

schema: $(READY)
	$(run) schema

plugins: $(READY)
	$(run) plugins

# of the templates as they are to be carried: what is edited after that is rendered wherever it can show
digests:
	@sha256sum $(sort $(templates)) > templates/SHA256SUMS

# only folders that hold resolved inputs: BUILD may hold a person's own files too
clean:
	@for inputs in $(BUILD)/$(or $(scene),*)$(if $(fog),/$(fog))/inputs; do \
	  [ ! -d "$$inputs" ] || rm -rf -- "$${inputs%/inputs}"; done; \
	rmdir -- $(BUILD) 2>/dev/null || true

help:
	@echo "targets"
	@echo "  make scene=NAME          fog in scenes/NAME, into build/NAME/ (report.html shows all of it)"
	@echo "  make closure scene=NAME  checks photograph * T + V against fog and surfaces rendered in one pass"
	@echo "  make export scene=NAME to=mitsuba   the scene for another renderer (mitsuba, pbrt), into build/NAME/export/mitsuba/"
	@echo "  make crosscheck scene=NAME   T and V of each light, and of all together, against Mitsuba 3's"
	@echo "  make compare scene=NAME  the same photograph in fog by us and by others, into build/NAME/compare/"
	@echo "  make truth scene=NAME    the model of bathroom, building, lamps or cornell itself in fog, for compare; long"
	@echo "  make tradeoff scene=NAME   time against error of each knob and of the plans, into build/NAME/tradeoff.png and .csv"
	@echo "  make calibrate           measures what the plan expects of time and error, on this machine; some hundred trials"
	@echo "  make figures             the paper's figures and its table from this project's scenes, into build/figures/figures.html and .pdf"
	@echo "  make ladder scene=NAME   the clear photograph and all named fogs side by side, into build/NAME/ladder.png"
	@echo "  make study               a page that asks which foggy picture is the real one, into build/study/study.html"
	@echo "  make study-results answers=FOLDER   what people answered: the paper's Fig. 15, with intervals and tests"
	@echo "  make study-truth scene=building fogs=\"NAME NAME\"   for the study: renders fog into the model of a scene that we made; some minutes a fog"
	@echo "  make match scene=NAME reference=FILE   the fog of a photograph of the same view, into its scene file; see build/NAME/match/"
	@echo "  make annotate scene=NAME [photo=FILE]   a page that annotates a photograph and shows its fog at once; photo begins a new scene"
	@echo "  make import-annotations scene=NAME file=FILE   what was drawn in fSpy, labelme, CVAT or COCO, into the scene file; replace=yes"
	@echo "  make export-annotations scene=NAME file=FILE   what the scene marks, for labelme; to=fspy: its camera for fSpy"
	@echo "  make photos              fetches the real demo photographs (sunroom, lobby, pagoda, street, bridge)"
	@echo "  make photograph scene=bathroom   renders the synthetic photograph again from its model"
	@echo "  make plugins             lists lights, shapes, media, ... with parameters and units"
	@echo "  make schema              writes scenes/scene.schema.json, for completion in editors"
	@echo "  make test, test-slow     the tests; with the slow ones"
	@echo "  make test-browser        the pages of the study and of annotating in a browser; installs Playwright and Chromium before"
	@echo "  make validation          the paper's Fig. 8, 9, 10: composite against ground truth, into build/validation/; long"
	@echo "  make fuzz                mutated scenes and pictures: only refusals in one line, or sane results"
	@echo "  make bench               seconds and errors of maps and fogs, beside Mitsuba 3's where it is installed, into build/bench/bench.md"
	@echo "  make bench-record        the same, kept in tests/benchmarks/results.md and history.csv"
	@echo "  make bench-lamps         times 200 lamps against 10 in a megapixel, some minutes"
	@echo "  make bench-full-size     times 24 megapixels against half a megapixel, with memory; some minutes"
	@echo "  make bench-tolerances    whether every plan keeps what it was asked, over all scenes; takes long"
	@echo "  make bench-preview       times the preview that a photograph's annotation shows, at a megapixel, and how far sliders are off"
	@echo "  make bench-match         whether a match finds fogs that are known, whatever the exposure and white balance"
	@echo "  make bench-annotate      times the annotation page: a slider, and a change of geometry, to the picture in a browser"
	@echo "  make setup               only installs what is needed"
	@echo "  make setup-mitsuba       installs Mitsuba 3 besides, for crosscheck"
	@echo "  make setup-figures       installs matplotlib besides, for tradeoff's and the study's figures"
	@echo "  make setup-browser       installs Playwright and Chromium besides, for test-browser"
	@echo "  make setup-annotate      installs Bokeh besides, for annotate"
	@echo "  make setup-compare       installs albumentations, imagecorruptions and euler-preprocess besides, for compare"
	@echo "  make digests             takes the templates as they are for those that the project carries"
	@echo "  make clean [scene=NAME [fog=NAME]]   removes results from build/"
	@echo "variables"
	@echo "  scene=NAME               folder under scenes/"
	@echo "  quality=draft|normal|final   how accurate: a relative error of 0.05, 0.01 or 0.002"
	@echo "  tolerance=0.02           relative error of the foggy photograph to stay below, instead of quality"
	@echo "  budget=10s               seconds for the fog in which to be as accurate as may be, instead of quality"
	@echo "  fog=NAME                 one of the scene's named fogs, into build/NAME/FOG/"
	@echo "  fogs=\"NAME NAME\"         which fogs the ladder shows, in this order"
	@echo "  study=FILE answers=FOLDER   description of a study (scenes/study.yaml), answers that people saved"
	@echo "  simulate=40 seed=1       so many who guess, for study-results; all that comes of it says SIMULATED"
	@echo "  reference_scene=NAME     the scene that the photograph in fog shows, where that is another one"
	@echo "  file=FILE replace=yes    annotations to import or export, and that what is there already may be replaced"
	@echo "  to=NAME fit=visibility,albedo,gains,g   what the matched fog is called (matched), and what is found (all but g)"
	@echo "  photo=FILE port=8000     the photograph of a new scene, for annotate, and where its page is (a free port)"
	@echo "  cases=2000 seed=1        how many mutations \`make fuzz\` tries, and which"
	@echo "  repeats=5                how many rounds \`make bench\` takes the medians of"
	@echo "  PATH.TO.VALUE=X          overrides any value: fog.visibility=3 lights.sun.gain=0.5 render.samples=48"
	@echo "  SCENES=DIR BUILD=DIR     where scenes and results are (scenes, build)"
	@echo "  PYTHON=python3.12        the Python to set up with; POVRAY=PROGRAM the POV-Ray to use"
